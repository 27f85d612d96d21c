"""Numbers of any width one after the other, the highest bit first; zeros fill the last byte."""


class BitWriter:
    """Puts numbers together."""

    def __init__(self) -> None:
        self._packed = self._count = 0

    def put(self, value: int, bits: int) -> None:
        """Add a number, 0 <= value < 2^bits."""
        self._packed, self._count = self._packed << bits | value, self._count + bits

    def to_bytes(self) -> bytes:
        """All that was put."""
        size = (self._count + 7) // 8
        return (self._packed << (8 * size - self._count)).to_bytes(size)


class BitReader:
    """Takes numbers apart again, from byte `position` of `data` on."""

    def __init__(self, data: bytes, position: int) -> None:
        self._data, self._bit = data, 8 * position

    def take(self, bits: int) -> int:
        """The next number.  Raises `ValueError` if the data ends before it does."""
        end = self._bit + bits
        if end > 8 * len(self._data):
            raise ValueError("cut off")
        covering = self._data[self._bit // 8 : (end + 7) // 8]
        self._bit = end
        return int.from_bytes(covering) >> (-end % 8) & ((1 << bits) - 1)

    def finish(self) -> int:
        """The number of bytes begun.  Raises `ValueError` if a bit left in the last is not 0."""
        if self.take(-self._bit % 8):
            raise ValueError("bits after the last one are not 0")
        return self._bit // 8
