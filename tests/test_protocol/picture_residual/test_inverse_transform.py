"""The lapped transform and its inverse."""

import numpy as np
import pytest

from encoder.residual.forward_transform import forward_transform
from encoder.residual.quantiser import quantise_tiles
from protocol.picture_residual.block_transform import dct_matrix, lapping_matrix
from protocol.picture_residual.inverse_transform import ResidualPictures
from protocol.picture_residual.residual_block import (
    ResidualTiles,
    step_size,
    tile_grid,
    tile_side,
)
from protocol.pictures.picture_codec import to_luma


@pytest.mark.parametrize("matrix", [dct_matrix(7), dct_matrix(16), lapping_matrix(16)])
def test_matrices_are_orthonormal(matrix: np.ndarray) -> None:
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(len(matrix)), atol=1e-6)


NOWHERE = np.zeros((80, 80), np.float32)


def differences(frames: int, height: int, width: int) -> np.ndarray:
    """A blob that moves, (frames, height, width, 3) float32."""
    rng = np.random.default_rng(3)
    t, y, x = np.mgrid[:frames, :height, :width]
    blob = np.exp(-((x - 20 - 2 * t) ** 2 + (y - 18) ** 2) / 60)
    grey = 70 * blob + rng.normal(0, 1, blob.shape)
    return np.stack([grey, 0.8 * grey, 0.9 * grey], -1).astype(np.float32)


@pytest.mark.parametrize("frames", [1, 5, 8])
@pytest.mark.parametrize(("height", "width"), [(48, 64), (41, 70), (16, 16)])
def test_a_fine_residual_restores_the_source(frames: int, height: int, width: int) -> None:
    wanted = differences(frames, height, width)
    values = forward_transform(list(wanted), tile_side(width, height))
    none_fine = np.zeros(tile_grid(width, height), np.bool_)
    tiles = ResidualTiles(2, *quantise_tiles(values, step_size(2), none_fine))
    drawn, nowhere = (
        np.full((height, width, 3), 90, np.uint8),
        np.zeros((height, width), np.float32),
    )
    pictures = ResidualPictures.from_tiles(tiles)
    for frame in range(frames):
        restored = pictures.add_to(drawn, frame, nowhere).astype(np.float32) - drawn
        error = to_luma(restored - wanted[frame])
        assert np.sqrt(np.mean(error**2)) < 1.3


def test_squared_errors_of_values_are_those_of_pixels() -> None:
    wanted = differences(8, 48, 64)
    values = forward_transform(list(wanted), tile_side(64, 48))[..., :64]
    np.testing.assert_allclose((values**2).sum(), (to_luma(wanted) ** 2).sum(), rtol=1e-4)


def test_pictures_without_values_stay_as_they_are() -> None:
    flags = np.zeros((3, 4), np.uint8)
    tiles = ResidualTiles(20, flags, np.zeros((3, 4, 8, 96), np.int16))
    drawn = np.random.default_rng(1).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    np.testing.assert_array_equal(
        ResidualPictures.from_tiles(tiles).add_to(drawn, 3, NOWHERE), drawn
    )


def test_a_tile_reaches_no_further_than_half_of_its_neighbours() -> None:
    flags = np.zeros((5, 5), np.uint8)
    flags[2, 2] = 1
    values = np.zeros((5, 5, 1, 96), np.int16)
    values[2, 2] = np.random.default_rng(2).integers(-5, 6, (1, 96))
    tiles = ResidualTiles(20, flags, values)
    changed = changed_pixels(tiles, NOWHERE)
    assert changed[12:28, 12:28].mean() > 0.9
    changed[12:28, 12:28] = False
    assert not changed.any()


def changed_pixels(tiles: ResidualTiles, face_area: np.ndarray) -> np.ndarray:
    grey = np.full((40, 40, 3), 128, np.uint8)
    shown = ResidualPictures.from_tiles(tiles).add_to(grey, 0, face_area)
    return np.asarray((shown != 128).any(-1))


def test_only_fine_tiles_are_added_to_the_face() -> None:
    left = np.zeros((40, 40), np.float32)
    left[:, :20] = 1
    values = np.random.default_rng(2).integers(-5, 6, (5, 5, 1, 96)).astype(np.int16)
    whole = ResidualTiles(20, np.ones((5, 5), np.uint8), values)
    changed = changed_pixels(whole, left)
    assert not changed[:, :20].any() and changed[:, 20:].mean() > 0.9
    fine = ResidualTiles(20, np.full((5, 5), 2, np.uint8), values)
    assert changed_pixels(fine, left).mean() > 0.9
