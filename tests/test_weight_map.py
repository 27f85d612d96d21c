"""The relief of a texture: what is coded is what is decoded, bounded, smooth, or refused."""

import numpy as np
import pytest

from protocol.packets import ProtocolError
from protocol.pictures.weight_map import (
    RANGE_OCTAVES,
    SIDE,
    STEP_OCTAVES,
    decode_relief,
    encode_relief,
)


def test_no_relief_is_even() -> None:
    assert np.array_equal(decode_relief("still", b"", 5, 9), np.ones((5, 9)))


def test_cells_keep_their_values_within_a_step() -> None:
    octaves = np.random.default_rng(1).uniform(*RANGE_OCTAVES, (SIDE, SIDE))
    found = decode_relief("still", encode_relief(np.exp2(octaves)), SIDE, SIDE)
    assert np.abs(np.log2(found) - octaves).max() < 2 * STEP_OCTAVES


def test_a_relief_is_continuous_at_any_size_and_within_its_range() -> None:
    rough = np.exp2(np.random.default_rng(2).normal(0, 4, (SIDE, SIDE)))
    found = decode_relief("still", encode_relief(rough), 97, 260)
    assert found.shape == (97, 260)
    low, high = np.exp2(RANGE_OCTAVES)
    assert found.min() >= low and found.max() <= high
    assert np.abs(np.diff(found, axis=1)).max() < (high - low) * SIDE / 260 + 1e-9


def test_a_usual_relief_is_small() -> None:
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    assert len(encode_relief(np.exp2(1 - (x**2 + y**2) / 30))) < 60


def test_what_is_no_relief_is_refused() -> None:
    with pytest.raises(ProtocolError, match="texture: relief"):
        decode_relief("texture", bytes(200), 16, 16)
