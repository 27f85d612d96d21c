"""The weight map of a texture: what is coded is what is decoded, bounded, smooth, or refused."""

import numpy as np
import pytest

from protocol.errors import ProtocolError
from protocol.pictures.weight_map import (
    GRID_SIDE,
    RANGE_OCTAVES,
    STEP_OCTAVES,
    decode_weight_map,
    encode_weight_map,
)


def test_no_weight_map_is_even() -> None:
    assert np.array_equal(decode_weight_map("still", b"", 5, 9), np.ones((5, 9)))


def test_cells_keep_their_values_within_a_step() -> None:
    octaves = np.random.default_rng(1).uniform(*RANGE_OCTAVES, (GRID_SIDE, GRID_SIDE))
    found = decode_weight_map("still", encode_weight_map(np.exp2(octaves)), GRID_SIDE, GRID_SIDE)
    assert np.abs(np.log2(found) - octaves).max() < 2 * STEP_OCTAVES


def test_a_weight_map_is_continuous_at_any_size_and_within_its_range() -> None:
    rough = np.exp2(np.random.default_rng(2).normal(0, 4, (GRID_SIDE, GRID_SIDE)))
    found = decode_weight_map("still", encode_weight_map(rough), 97, 260)
    assert found.shape == (97, 260)
    low, high = np.exp2(RANGE_OCTAVES)
    assert found.min() >= low and found.max() <= high
    assert np.abs(np.diff(found, axis=1)).max() < (high - low) * GRID_SIDE / 260 + 1e-9


def test_a_typical_weight_map_is_small() -> None:
    y, x = np.mgrid[:GRID_SIDE, :GRID_SIDE] - (GRID_SIDE - 1) / 2
    assert len(encode_weight_map(np.exp2(1 - (x**2 + y**2) / 30))) < 60


def test_a_damaged_weight_map_is_refused() -> None:
    with pytest.raises(ProtocolError, match="texture: weight map"):
        decode_weight_map("texture", bytes(200), 16, 16)
