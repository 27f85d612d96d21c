"""Adaptive binary probabilities, and signed integers coded by them.

Tables of model packets, residual shapes, weight maps, foreground masks and the lowpass subbands of
pictures are coded with these models.  A context adapts fast at first and at a constant rate after
`MAX_COUNT` bits.  The arithmetic is in integers; encoder and decoder run the same code.
"""

from protocol.entropy.integer_codes import code_bits
from protocol.entropy.range_coder import PROBABILITY_ONE, BitCoder

# Bits after which the adaptation rate of a context stays the same.
MAX_COUNT = 60
MIN_PROBABILITY = 96


class AdaptiveBits:
    """`count` contexts; the probability of a zero starts at `zero` / 65536."""

    def __init__(self, count: int, zero: int = PROBABILITY_ONE // 2) -> None:
        self._zero = [zero] * count
        self._counts = [0] * count

    def code(self, coder: BitCoder, context: int, bit: int) -> int:
        """Code `bit` in `context` and adapt the context; a decoder ignores `bit`.

        Returns the bit coded.
        """
        zero, count = self._zero[context], self._counts[context]
        bit = coder.code_bit(bit, zero)
        target = 0 if bit else PROBABILITY_ONE
        zero += (target - zero) * 2 // (2 * count + 4)
        self._zero[context] = min(max(zero, MIN_PROBABILITY), PROBABILITY_ONE - MIN_PROBABILITY)
        if count < MAX_COUNT:
            self._counts[context] = count + 1
        return bit


class AdaptiveIntegers:
    """Signed integers in `count` contexts: an Exp-Golomb code whose prefix bits are adaptive.

    Magnitudes go up to 2 ** (`LONGEST` + 1) - 2.
    """

    LONGEST = 14

    def __init__(self, count: int) -> None:
        self._lengths = AdaptiveBits(count * (self.LONGEST + 1))

    def code(self, coder: BitCoder, context: int, value: int) -> int:
        """Code `value` in `context`; a decoder ignores it.  Returns the value coded.

        Raises `ValueError` if the prefix is longer than `LONGEST`.
        """
        shifted, length = abs(value) + 1, 0
        first = context * (self.LONGEST + 1)
        while self._lengths.code(coder, first + length, int(shifted >> length > 1)):
            length += 1
            if length > self.LONGEST:
                raise ValueError("a value is too large")
        if not length:
            return 0
        magnitude = (1 << length | code_bits(coder, shifted, length)) - 1
        negative = coder.code_bit(int(value < 0), PROBABILITY_ONE // 2)
        return -magnitude if negative else magnitude
