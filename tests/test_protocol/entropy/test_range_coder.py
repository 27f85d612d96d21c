"""The range coder: exact, short, and safe on any bytes."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.entropy.range_coder import PROBABILITY_ONE, RangeDecoder, RangeEncoder

decisions = st.lists(
    st.tuples(st.integers(0, 1), st.integers(1, PROBABILITY_ONE - 1)), max_size=200
)


def encode(pairs: list[tuple[int, int]]) -> bytes:
    """Bytes of (bit, probability of zero) decisions."""
    coder = RangeEncoder()
    for bit, zero in pairs:
        assert coder.code_bit(bit, zero) == bit
    return coder.finish()


def information(pairs: list[tuple[int, int]]) -> float:
    """Bits that the decisions hold under their probabilities."""
    return -sum(
        math.log2((PROBABILITY_ONE - zero if bit else zero) / PROBABILITY_ONE)
        for bit, zero in pairs
    )


def drawn(seed: int, count: int) -> list[tuple[int, int]]:
    """Decisions that keep to their probabilities, most of them unequal."""
    rng = random.Random(seed)
    zeros = [
        min(max(int(PROBABILITY_ONE * rng.betavariate(0.5, 0.5)), 1), PROBABILITY_ONE - 1)
        for _ in range(count)
    ]
    return [(int(rng.random() * PROBABILITY_ONE >= zero), zero) for zero in zeros]


def test_golden_bytes_have_not_changed() -> None:
    assert encode(drawn(1, 60)).hex() == "08a48d26"


@given(decisions)
def test_every_decision_comes_back(pairs: list[tuple[int, int]]) -> None:
    decoder = RangeDecoder(encode(pairs))
    assert [decoder.code_bit(0, zero) for _, zero in pairs] == [bit for bit, _ in pairs]
    assert decoder.unread_bytes == 0


@given(decisions)
def test_a_byte_less_would_not_do(pairs: list[tuple[int, int]]) -> None:
    data = encode(pairs)
    if data:
        decoder = RangeDecoder(data[:-1])
        assert [decoder.code_bit(0, zero) for _, zero in pairs] != [bit for bit, _ in pairs]


def test_likely_zeros_cost_no_byte() -> None:
    assert encode([(0, 60000)] * 500) == b""
    assert encode([]) == b""


def test_carries_propagate_through_all_bytes() -> None:
    ones, last = [(1, PROBABILITY_ONE // 2)] * 400, (0, PROBABILITY_ONE - 1)
    data = encode([*ones, last])
    assert data == b"\xff" * 50
    assert encode([*ones[:-1], (1, PROBABILITY_ONE // 2 - 1), (1, 1)]) == b"\xff" * 50
    decoder = RangeDecoder(data)
    assert [decoder.code_bit(0, zero) for _, zero in [*ones, last]] == [1] * 400 + [0]


def test_long_strings_are_coded_in_time_by_their_length() -> None:
    pairs = drawn(5, 200_000)
    decoder = RangeDecoder(encode(pairs))
    assert all(decoder.code_bit(0, zero) == bit for bit, zero in pairs)


def test_the_worst_case_costs_sixteen_bits_a_decision() -> None:
    assert len(encode([(0, 1), (1, PROBABILITY_ONE - 1)] * 50)) <= 201


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_packets_are_as_short_as_their_information(count: int) -> None:
    seeds = range(200 if count < 1000 else 20)
    excess = [8 * len(encode(drawn(s, count))) - information(drawn(s, count)) for s in seeds]
    assert max(excess) < 10
    # Half a byte of rounding on average, and next to nothing besides.
    assert sum(excess) / len(excess) < 4.8


@given(st.binary(max_size=40), st.lists(st.integers(1, PROBABILITY_ONE - 1), max_size=300))
def test_any_bytes_decode_to_something(data: bytes, zeros: list[int]) -> None:
    decoder = RangeDecoder(data)
    bits = [decoder.code_bit(0, zero) for zero in zeros]
    assert set(bits) <= {0, 1}
    again = encode(list(zip(bits, zeros, strict=True)))
    assert len(again) <= max(len(data), 6 + 2 * len(zeros))


def test_bytes_that_nothing_depends_on_are_counted() -> None:
    pairs = drawn(3, 50)
    data = encode(pairs)
    decoder = RangeDecoder(data + bytes(20))
    for _, zero in pairs:
        decoder.code_bit(0, zero)
    assert 20 - 6 <= decoder.unread_bytes <= 20
