"""The residual shape on the wire: decoding inverts coding, damage is refused."""

import random

import pytest

from protocol.limits import MAX_RESIDUAL_BYTES, MAX_RESIDUAL_POINTS
from protocol.model_packet import parse_residual, serialise_residual


@pytest.mark.parametrize("points", [0, 1, 60, MAX_RESIDUAL_POINTS])
def test_residual_shapes_survive_the_wire(points: int) -> None:
    rng = random.Random(points)
    for size in (0, 1, 8, 127):
        codes = tuple(rng.randint(-size, size) for _ in range(3 * points))
        data = serialise_residual(codes)
        assert parse_residual(data) == codes
        assert len(data) <= MAX_RESIDUAL_BYTES


def test_small_displacements_take_less_than_a_byte_each() -> None:
    rng = random.Random(7)
    codes = tuple(round(rng.gauss(0, 6)) for _ in range(180))
    assert len(serialise_residual(codes)) < 0.75 * len(codes)


def test_bytes_too_many_are_told() -> None:
    with pytest.raises(ValueError, match="bytes too many"):
        parse_residual(serialise_residual((1, 2, 3)) + bytes(12))
