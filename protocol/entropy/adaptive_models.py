"""Probabilities that learn: what model packets' tables, residual shapes and
reliefs and the coarsest subbands of stills are coded with.

Each context counts what it has seen, so early bits teach much and later ones less.  All is
integer; encoder and decoder run the same code.
"""

from protocol.entropy.range_coder import WHOLE
from protocol.frames.value_coding import BitCoder

# A context that has seen this many bits forgets at a steady rate.
_MEMORY = 60
_LEAST = 96


class AdaptiveBits:
    """`count` contexts, each of which starts at probability `zero` / 65536 of a zero."""

    def __init__(self, count: int, zero: int = WHOLE // 2) -> None:
        self._zero = [zero] * count
        self._seen = [0] * count

    def code(self, coder: BitCoder, context: int, bit: int) -> int:
        """Code `bit` in `context` and learn from it; a decoder ignores `bit`.  Returns the bit."""
        zero, seen = self._zero[context], self._seen[context]
        bit = coder.code_bit(bit, zero)
        target = 0 if bit else WHOLE
        zero += (target - zero) * 2 // (2 * seen + 4)
        self._zero[context] = min(max(zero, _LEAST), WHOLE - _LEAST)
        if seen < _MEMORY:
            self._seen[context] = seen + 1
        return bit


class AdaptiveIntegers:
    """Signed integers, small ones most likely, in `count` contexts: Elias' gamma code, learning.

    Sizes go up to 2 ** (`LONGEST` + 1) - 2.
    """

    LONGEST = 14

    def __init__(self, count: int) -> None:
        self._lengths = AdaptiveBits(count * (self.LONGEST + 1))

    def code(self, coder: BitCoder, context: int, value: int) -> int:
        """Code `value` in `context`; a decoder ignores it.  Returns the value.

        Raises `ValueError` if a decoder reads a size that no encoder writes.
        """
        size, length = abs(value) + 1, 0
        first = context * (self.LONGEST + 1)
        while self._lengths.code(coder, first + length, int(size >> length > 1)):
            length += 1
            if length > self.LONGEST:
                raise ValueError("a value is too large")
        if not length:
            return 0
        found = 1
        for place in reversed(range(length)):
            found = found << 1 | coder.code_bit(size >> place & 1, WHOLE // 2)
        negative = coder.code_bit(int(value < 0), WHOLE // 2)
        return 1 - found if negative else found - 1
