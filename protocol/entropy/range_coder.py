"""A byte-wise binary range coder with given probabilities, all in integers.

Probabilities are in 1 / 65536.  The encoder keeps its low end in integers of unbounded length, so
there is no carry to propagate; `finish` returns the fewest bytes that name a point of the final
interval; the decoder reads zeros past the end.  Zeros take the lower part of the interval: likely
zeros and nothing else cost no byte at all.  After Martin, "Range encoding", 1979.
"""

from bisect import bisect_left

PROBABILITY_BITS = 16
WHOLE = 1 << PROBABILITY_BITS
# Wide enough that the interval is never split more coarsely than the probabilities say.
_TOP_BITS = 48
_LEAST_RANGE = 1 << 40
# Adding to a long integer takes time by its length: what is above so many bits is put aside.
_SHORT_BITS = 1024


class RangeEncoder:
    """Collects decisions; `finish` gives their bytes."""

    def __init__(self) -> None:
        self._low, self._range, self._shifted = 0, 1 << _TOP_BITS, 0
        self._aside: list[tuple[int, int]] = []

    def code_bit(self, bit: int, zero: int) -> int:
        """Code `bit`, 0 with probability `zero` / 65536, 0 < zero < 65536; returns it."""
        split = (self._range >> PROBABILITY_BITS) * zero
        if bit:
            self._low += split
            self._range -= split
        else:
            self._range = split
        while self._range < _LEAST_RANGE:
            self._low <<= 8
            self._range <<= 8
            self._shifted += 8
        if self._shifted > _SHORT_BITS:
            self._aside.append((self._low >> _TOP_BITS, self._shifted))
            self._low, self._shifted = self._low & (1 << _TOP_BITS) - 1, 0
        return bit

    def finish(self) -> bytes:
        """The shortest bytes from which a `RangeDecoder` reads what was coded."""
        low, total = 0, _TOP_BITS
        for part, bits in (*self._aside, (self._low >> _TOP_BITS, self._shifted)):
            low, total = (low << bits) + part, total + bits
        low = (low << _TOP_BITS) + (self._low & (1 << _TOP_BITS) - 1)

        def point(length: int) -> int:
            """The lowest point from `low` on that has so many bytes, in units of the last one."""
            return -(-low >> total - 8 * length)

        length = bisect_left(
            range(total // 8),
            True,
            key=lambda n: point(n) << total - 8 * n < low + self._range,
        )
        return point(length).to_bytes(length, "big")


class RangeDecoder:
    """Reads decisions out of bytes; any bytes decode to something."""

    def __init__(self, data: bytes) -> None:
        self._data, self._place = data, _TOP_BITS // 8
        self._code = int.from_bytes(data[: self._place].ljust(self._place, b"\0"), "big")
        self._range = 1 << _TOP_BITS

    @property
    def surplus(self) -> int:
        """Number of bytes that nothing decoded so far depends on."""
        return max(0, len(self._data) - self._place)

    def code_bit(self, bit: int, zero: int) -> int:
        """The next bit, which is 0 with probability `zero` / 65536; `bit` is ignored."""
        split = (self._range >> PROBABILITY_BITS) * zero
        bit = int(self._code >= split)
        if bit:
            self._code -= split
            self._range -= split
        else:
            self._range = split
        while self._range < _LEAST_RANGE:
            byte = self._data[self._place] if self._place < len(self._data) else 0
            self._code = self._code << 8 | byte
            self._range <<= 8
            self._place += 1
        return bit
