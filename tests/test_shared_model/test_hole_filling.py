"""Holes are filled smoothly from around, and what is known stays."""

import numpy as np
import pytest

from shared_model.appearance import Atlas, filled_atlas, pull_push_fill


def test_filling_is_smooth_and_keeps_known_pixels() -> None:
    image = np.zeros((33, 47, 3), np.float32)
    image[...] = np.linspace(0, 255, 47)[None, :, None]
    known = np.zeros((33, 47), bool)
    known[:, :8] = known[:, -8:] = True
    filled = pull_push_fill(np.where(known[..., None], image, 999).astype(np.float32), known)
    assert np.array_equal(filled[known], image[known])
    assert filled.min() >= 0 and filled.max() <= 255.001
    assert np.abs(np.diff(filled, axis=1)).max() < 40


@pytest.mark.parametrize("shape", [(37, 50), (1, 9), (64, 64)])
@pytest.mark.parametrize("channels", [1, 3])
def test_an_even_picture_is_continued_as_it_is(shape: tuple[int, int], channels: int) -> None:
    known = np.random.default_rng(2).random(shape) < 0.4
    even = np.full((*shape, channels), 90, np.float32)
    filled = pull_push_fill(np.where(known[..., None], even, 0), known)
    assert filled.dtype == np.float32 and np.allclose(filled, even)


def test_where_nothing_is_known_the_picture_is_zero() -> None:
    image = np.full((33, 47, 3), 90, np.float32)
    assert not pull_push_fill(image, np.zeros((33, 47), bool)).any()


def test_an_atlas_keeps_its_texels() -> None:
    rows, columns = (axis.ravel().astype(np.int32) for axis in np.mgrid[2:6, 1:5])
    atlas = Atlas(8, rows, columns, np.zeros((16, 3), np.int32), np.zeros((16, 3)))
    colours = np.random.default_rng(1).random((16, 3)).astype(np.float32)
    image = filled_atlas(atlas, colours)
    assert np.array_equal(image[rows, columns], colours)
    assert colours.min() <= image.min() and image.max() <= colours.max() + 1e-6
