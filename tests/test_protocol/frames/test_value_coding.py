"""The coding of values: exact at every size, near their information, the same at both ends."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.entropy.integer_codes import code_bits
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder
from protocol.frames.value_coding import (
    LOWEST_TABLE,
    MAX_MAGNITUDE,
    TABLES,
    UNARY_LIMIT,
    ValueContext,
    code_value,
    context_tables,
    value_bits,
)

values = st.one_of(
    st.integers(-3, 3), st.integers(-60, 60), st.integers(-MAX_MAGNITUDE, MAX_MAGNITUDE)
)


@given(st.lists(st.tuples(values, st.integers(0, TABLES - 1)), max_size=60))
def test_values_survive_under_any_table(pairs: list[tuple[int, int]]) -> None:
    encoder = RangeEncoder()
    for value, table in pairs:
        assert code_value(encoder, value, table) == value
    decoder = RangeDecoder(encoder.finish())
    assert [code_value(decoder, 0, table) for _, table in pairs] == [value for value, _ in pairs]


@pytest.mark.parametrize(
    "size", [0, 1, UNARY_LIMIT - 1, UNARY_LIMIT, UNARY_LIMIT + 1, UNARY_LIMIT + 16, MAX_MAGNITUDE]
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_every_way_of_coding_a_size_is_exact(size: int, sign: int) -> None:
    encoder = RangeEncoder()
    code_value(encoder, sign * size, TABLES - 1)
    assert code_value(RangeDecoder(encoder.finish()), 0, TABLES - 1) == sign * size


def test_a_value_beyond_the_largest_is_refused_at_both_ends() -> None:
    with pytest.raises(ValueError, match="too large"):
        code_value(RangeEncoder(), MAX_MAGNITUDE + 1, 0)
    with pytest.raises(ValueError, match="too large"):
        code_value(RangeDecoder(b"\xff" * 80), 0, TABLES - 1)


@given(st.integers(0, 2**12 - 1))
def test_plain_bits_survive(value: int) -> None:
    encoder = RangeEncoder()
    assert code_bits(encoder, value, 12) == value
    assert code_bits(RangeDecoder(encoder.finish()), 0, 12) == value


def test_the_stated_bits_are_those_spent() -> None:
    rng = random.Random(7)
    costs = value_bits()
    for table in (4, 12, 20, 24, 28):
        drawn = laplacian(rng, table, 2000)
        encoder = RangeEncoder()
        for value in drawn:
            code_value(encoder, value, table)
        stated = sum(costs[table][min(abs(value), UNARY_LIMIT)] for value in drawn)
        assert 8 * len(encoder.finish()) == pytest.approx(stated, abs=10, rel=0.005)


def test_a_table_is_best_for_values_of_its_scale() -> None:
    rng = random.Random(8)
    costs = value_bits()
    for table in range(8, 44, 4):
        sizes = np.minimum(np.abs(laplacian(rng, table, 4000)), UNARY_LIMIT)
        spent = costs[:, sizes].sum(1)
        assert abs(int(spent.argmin()) - table) <= 2


def laplacian(rng: random.Random, table: int, count: int) -> list[int]:
    """Rounded Laplacian values of the scale that `table` is for."""
    scale = 2 ** ((table + LOWEST_TABLE) / 4)
    return [round(rng.choice((-1, 1)) * rng.expovariate(1 / scale)) for _ in range(count)]


def test_every_value_keeps_a_probability() -> None:
    costs = value_bits()
    assert np.isfinite(costs).all() and (costs > 0).all()
    assert (2.0 ** -costs[:, 0] + 2 * (2.0 ** -costs[:, 1:]).sum(1) <= 1 + 1e-9).all()


def test_context_raises_the_table_of_a_packet_with_much_motion() -> None:
    still, moving = ValueContext(), ValueContext()
    for _ in range(3):
        for packet, size in ((still, 0), (moving, 9)):
            packet.start_frame()
            for _ in range(20):
                packet.update(24, size)
    still.start_frame()
    moving.start_frame()
    assert still.table(24, 0) < 24 < moving.table(24, 2)


def test_tables_stay_within_bounds() -> None:
    context = ValueContext()
    context.start_frame()
    assert context.table(0, 0) == 0
    for _ in range(50):
        context.update(0, MAX_MAGNITUDE)
    assert context.table(TABLES - 1, MAX_MAGNITUDE) == TABLES - 1


@given(st.integers(1, 8), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_tables_are_the_same_all_at_once(frames: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    expected = rng.integers(0, TABLES, (frames, count))
    parents = rng.integers(0, 4, (frames, count))
    sizes = rng.integers(0, 30, (frames, count)) * rng.integers(0, 2, (frames, count))
    context, tables = ValueContext(), []
    for frame in range(frames):
        context.start_frame()
        for usual, parent, size in zip(
            expected[frame].tolist(), parents[frame].tolist(), sizes[frame].tolist(), strict=True
        ):
            tables.append(context.table(usual, parent))
            context.update(usual, size)
    found = context_tables(expected, parents, sizes)
    assert found.tolist() == np.reshape(tables, (frames, count)).tolist()
