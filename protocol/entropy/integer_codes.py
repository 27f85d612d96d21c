"""Integers of given codes, without a model of their probabilities."""

from protocol.entropy.range_coder import PROBABILITY_ONE, BitCoder


def code_bits(coder: BitCoder, value: int, count: int) -> int:
    """Code the `count` lowest bits of `value`, highest first, each with probability 1/2.

    A decoder ignores `value`.  Returns the bits coded.
    """
    coded = 0
    for position in reversed(range(count)):
        coded = coded << 1 | coder.code_bit(value >> position & 1, PROBABILITY_ONE // 2)
    return coded


def code_exp_golomb(coder: BitCoder, value: int, longest: int) -> int:
    """Code `value` >= 0, at most 2 ** (`longest` + 1) - 2, by the Exp-Golomb code of order 0.

    A one for each bit of `value` + 1 after its highest, a zero, then those bits.  A decoder ignores
    `value`.  Returns the value coded.  Raises `ValueError` if there are more than `longest` ones.
    """
    shifted, length = value + 1, 0
    while coder.code_bit(int(shifted >> length > 1), PROBABILITY_ONE // 2):
        length += 1
        if length > longest:
            raise ValueError("a value is too large")
    return (1 << length | code_bits(coder, shifted, length)) - 1
