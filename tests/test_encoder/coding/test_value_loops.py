"""Compiled coding of a packet's values gives what the protocol gives value by value."""

import numpy as np
import pytest

from encoder.coding.value_loops import new_context, round_adaptively, value_decisions
from encoder.picture_coding.symbol_writing import range_coded
from protocol.entropy.range_coder import RangeEncoder
from protocol.frames.value_coding import (
    MAX_MAGNITUDE,
    TABLES,
    UNARY_LIMIT,
    ValueContext,
    code_value,
    value_bits,
)

FRAMES, COMPONENTS = 4, 30
LARGE = [UNARY_LIMIT - 1, UNARY_LIMIT, UNARY_LIMIT + 1, UNARY_LIMIT + 17, 3000, MAX_MAGNITUDE]


@pytest.mark.parametrize("spread", [0.3, 2.0, 30.0])
def test_values_are_coded_as_one_by_one(spread: float) -> None:
    rng = np.random.default_rng(3)
    values = np.rint(rng.laplace(0, spread, (FRAMES, COMPONENTS))).astype(np.int64)
    values[1, : len(LARGE)] = LARGE
    values[2, : len(LARGE)] = np.negative(LARGE)
    tables = rng.integers(0, TABLES, values.shape)
    references = rng.integers(0, 4, values.shape)
    coder, context = RangeEncoder(), ValueContext()
    for row, of_row, sums in zip(values, tables, references, strict=True):
        context.start_frame()
        for value, base, reference in zip(
            row.tolist(), of_row.tolist(), sums.tolist(), strict=True
        ):
            code_value(coder, value, context.table(base, reference))
            context.update(base, abs(value))
    assert range_coded([value_decisions(values, tables, references)]) == coder.finish()


def test_magnitudes_are_those_of_least_cost_in_their_context() -> None:
    rng, bits, lagrangian = np.random.default_rng(4), value_bits(), 0.25
    context, compiled = ValueContext(), new_context()
    for _ in range(FRAMES):
        sizes = rng.exponential(1.5, COMPONENTS)
        tables = rng.integers(0, TABLES, COMPONENTS)
        references = rng.integers(0, 4, COMPONENTS)
        chosen = round_adaptively(sizes, tables, references, bits, lagrangian, compiled)
        context.start_frame()
        for size, base, reference, magnitude in zip(
            sizes.tolist(), tables.tolist(), references.tolist(), chosen.tolist(), strict=True
        ):
            row = bits[context.table(base, reference)]
            nearest = round(size)
            candidates = (nearest, nearest - 1, 0) if nearest else (0,)
            cost = [(size - each) ** 2 + lagrangian * row[each] for each in candidates]
            assert magnitude == candidates[int(np.argmin(cost))]
            context.update(base, magnitude)
