"""A byte-wise binary range coder with given probabilities, in integer arithmetic.

Probabilities are in 1 / 65536.  The encoder holds its low end in an integer of unbounded length, so
no carry has to be propagated.  `finish` returns the fewest bytes that name a point of the final
interval, and the decoder reads zeros past their end.  A zero takes the lower part of the interval:
a message of likely zeros alone has no bytes.  After Martin, "Range encoding", 1979.
"""

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import numpy as np

from shared_model.arrays import Integers, Picture

PROBABILITY_BITS = 16
PROBABILITY_ONE = 1 << PROBABILITY_BITS
# The range exceeds 2 ** 40, so its split follows the probabilities to within 2 ** -24.
TOP_BITS = 48
LEAST_RANGE = 1 << 40
# The time of an addition grows with the length of the integer: longer low ends are flushed.
_FLUSH_BITS = 1024


class BitCoder(Protocol):
    """A range encoder, or a range decoder, which ignores the bit that it is given."""

    def code_bit(self, bit: int, zero: int) -> int:
        """Code `bit`, which is 0 with probability `zero` / 65536, and return it."""


class RangeEncoder:
    """Codes bits; `finish` returns the bytes."""

    def __init__(self) -> None:
        self._low, self._range, self._shifted = 0, 1 << TOP_BITS, 0
        self._flushed: list[tuple[int, int]] = []

    def code_bit(self, bit: int, zero: int) -> int:
        """Code `bit`, which is 0 with probability `zero` / 65536, 0 < `zero` < 65536; return it."""
        split = (self._range >> PROBABILITY_BITS) * zero
        if bit:
            self._low += split
            self._range -= split
        else:
            self._range = split
        while self._range < LEAST_RANGE:
            self._low <<= 8
            self._range <<= 8
            self._shifted += 8
        if self._shifted > _FLUSH_BITS:
            self._flushed.append((self._low >> TOP_BITS, self._shifted))
            self._low, self._shifted = self._low & (1 << TOP_BITS) - 1, 0
        return bit

    def finish(self) -> bytes:
        """The fewest bytes from which a `RangeDecoder` reads the bits coded."""
        low, total = 0, TOP_BITS
        for part, bits in (*self._flushed, (self._low >> TOP_BITS, self._shifted)):
            low, total = (low << bits) + part, total + bits
        low = (low << TOP_BITS) + (self._low & (1 << TOP_BITS) - 1)
        return shortest_point(low, self._range, total)


def shortest_point(low: int, size: int, bits: int) -> bytes:
    """The fewest bytes that name a point from `low` on, within `size`, of numbers of `bits` bits.

    bits: a multiple of 8.
    """

    def point(length: int) -> int:
        """The lowest point from `low` on that has `length` bytes, in units of the last one."""
        return -(-low >> bits - 8 * length)

    length = bisect_left(
        range(bits // 8), True, key=lambda n: point(n) << bits - 8 * n < low + size
    )
    return point(length).to_bytes(length, "big")


class RangeDecoder:
    """Reads bits from bytes; any bytes can be decoded."""

    def __init__(self, data: bytes) -> None:
        self._data, self._position = data, TOP_BITS // 8
        self._code = int.from_bytes(data[: self._position].ljust(self._position, b"\0"), "big")
        self._range = 1 << TOP_BITS

    @property
    def unread_bytes(self) -> int:
        """Number of bytes at the end on which no bit decoded so far depends."""
        return max(0, len(self._data) - self._position)

    @contextmanager
    def registers(self) -> Iterator[tuple[Picture, Integers]]:
        """The bytes (n,), and code, range and position (3,) for a compiled loop to go on from.

        What the loop makes of the three is taken over at the end of the `with` block.
        """
        registers = np.array([self._code, self._range, self._position], np.int64)
        yield np.frombuffer(self._data, np.uint8), registers
        self._code, self._range, self._position = registers.tolist()

    def code_bit(self, bit: int, zero: int) -> int:
        """The next bit, which is 0 with probability `zero` / 65536; `bit` is ignored."""
        split = (self._range >> PROBABILITY_BITS) * zero
        bit = int(self._code >= split)
        if bit:
            self._code -= split
            self._range -= split
        else:
            self._range = split
        while self._range < LEAST_RANGE:
            byte = self._data[self._position] if self._position < len(self._data) else 0
            self._code = self._code << 8 | byte
            self._range <<= 8
            self._position += 1
        return bit
