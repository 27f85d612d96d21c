"""A byte-wise range coder with given probabilities, all in integers.

Probabilities are in 1 / 65536.  The encoder keeps its low end as one unbounded integer, so there is no
carry to propagate, and `finish` returns the fewest bytes that name a point of the final interval; the
decoder reads zeros past the end.  After Martin, "Range encoding", 1979.
"""

PROBABILITY_BITS = 16
WHOLE = 1 << PROBABILITY_BITS
_TOP_BITS = 32
_LEAST_RANGE = 1 << 24


class RangeEncoder:
    """Collects decisions; `finish` gives their bytes."""

    def __init__(self) -> None:
        self._low, self._range, self._shifted = 0, 1 << _TOP_BITS, 0

    def encode_bit(self, bit: int, zero: int) -> None:
        """Code `bit`, 0 with probability `zero` / 65536, 0 < zero < 65536."""
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

    def encode_bits(self, value: int, count: int) -> None:
        """Code the `count` lowest bits of `value`, all as likely as not."""
        for place in reversed(range(count)):
            self.encode_bit(value >> place & 1, WHOLE // 2)

    def finish(self) -> bytes:
        """The shortest bytes from which a `RangeDecoder` reads what was coded."""
        total = _TOP_BITS + self._shifted
        for length in range(total // 8 + 1):
            shift = total - 8 * length
            value = -(-self._low >> shift)
            if value << shift < self._low + self._range:
                return value.to_bytes(length, "big")
        raise AssertionError("an interval of at least one point has a name of full length")


class RangeDecoder:
    """Reads decisions out of bytes; any bytes decode to something."""

    def __init__(self, data: bytes) -> None:
        self._data, self._place = data, 4
        self._code = int.from_bytes(data[:4].ljust(4, b"\0"), "big")
        self._range = 1 << _TOP_BITS

    def decode_bit(self, zero: int) -> int:
        """The next bit, which is 0 with probability `zero` / 65536."""
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

    def decode_bits(self, count: int) -> int:
        """The next `count` bits, all as likely as not."""
        value = 0
        for _ in range(count):
            value = value << 1 | self.decode_bit(WHOLE // 2)
        return value
