"""Adaptive models: both ends agree, codes become shorter, every magnitude is exact."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.entropy.adaptive_models import AdaptiveBits, AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder

LARGEST = 2**AdaptiveIntegers.LONGEST - 1
VALUES = st.one_of(st.integers(-3, 3), st.integers(-LARGEST, LARGEST))


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 1)), max_size=300))
def test_bits_survive_in_any_context(pairs: list[tuple[int, int]]) -> None:
    coder, ours, theirs = RangeEncoder(), AdaptiveBits(4), AdaptiveBits(4)
    for context, bit in pairs:
        assert ours.code(coder, context, bit) == bit
    decoder = RangeDecoder(coder.finish())
    assert [theirs.code(decoder, context, 0) for context, _ in pairs] == [b for _, b in pairs]


@given(st.lists(st.tuples(st.integers(0, 2), VALUES), max_size=60))
def test_integers_survive_in_any_context(pairs: list[tuple[int, int]]) -> None:
    coder, ours, theirs = RangeEncoder(), AdaptiveIntegers(3), AdaptiveIntegers(3)
    for context, value in pairs:
        assert ours.code(coder, context, value) == value
    decoder = RangeDecoder(coder.finish())
    assert [theirs.code(decoder, context, 0) for context, _ in pairs] == [v for _, v in pairs]


@pytest.mark.parametrize("value", [0, 1, -1, LARGEST, -LARGEST, 2 * LARGEST, -2 * LARGEST])
def test_the_largest_values_are_exact(value: int) -> None:
    coder = RangeEncoder()
    AdaptiveIntegers(1).code(coder, 0, value)
    assert AdaptiveIntegers(1).code(RangeDecoder(coder.finish()), 0, 0) == value


def test_a_value_beyond_the_largest_is_refused_at_both_ends() -> None:
    with pytest.raises(ValueError, match="too large"):
        AdaptiveIntegers(1).code(RangeEncoder(), 0, 1 << 20)
    with pytest.raises(ValueError, match="too large"):
        AdaptiveIntegers(1).code(RangeDecoder(b"\xff" * 40), 0, 0)


def test_an_adapted_context_costs_less() -> None:
    rng = random.Random(3)
    bits = [int(rng.random() < 0.03) for _ in range(4000)]
    coder, learning = RangeEncoder(), AdaptiveBits(1)
    for bit in bits:
        learning.code(coder, 0, bit)
    # Their information is 0.19 bits each.
    assert 0.19 * 4000 < 8 * len(coder.finish()) < 0.23 * 4000


def test_contexts_adapt_independently() -> None:
    together, apart = RangeEncoder(), RangeEncoder()
    one, two = AdaptiveBits(1), AdaptiveBits(2)
    for turn in range(600):
        one.code(together, 0, turn % 2)
        two.code(apart, turn % 2, turn % 2)
    assert len(apart.finish()) < 0.2 * len(together.finish())
