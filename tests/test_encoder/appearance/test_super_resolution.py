"""Back-projected textures reproduce the picture better than sampled ones."""

import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.super_resolution import back_projected, inverse_warp
from encoder.appearance.texel_visibility import visible_texels
from protocol.pictures.picture_codec import to_luma
from runtime.image_ops import sample_bicubic
from shared_model.appearance import atlas_of
from shared_model.arrays import Picture, Single


@pytest.fixture(scope="module")
def shape(shots: Shots) -> ShapeFreeFrame:
    return ShapeFreeFrame(shots.face, atlas_of(shots.face.head, 192), shots.camera)


@pytest.fixture(scope="module")
def detailed() -> Picture:
    """A picture with detail as fine as pixels show."""
    noise = np.random.default_rng(6).integers(60, 200, (120, 160, 3), dtype=np.uint8)
    return np.asarray(np.repeat(np.repeat(noise, 2, 0), 2, 1), np.uint8)


def drawn(shape: ShapeFreeFrame, colours: Single, texels: Single) -> Single:
    """(p, 3) what a bilinear renderer shows at texture places (p, 2)."""
    image = np.zeros((shape.atlas.size, shape.atlas.size, 3), np.float32)
    image[shape.atlas.rows, shape.atlas.columns] = colours
    return sample_bilinear(image, texels)


def sample_bilinear(image: Single, places: Single) -> Single:
    low = np.floor(places).astype(int)
    x, y = (places - low).T[..., None].astype(np.float32)
    column, row = low.T
    top = image[row, column] * (1 - x) + image[row, column + 1] * x
    bottom = image[row + 1, column] * (1 - x) + image[row + 1, column + 1] * x
    return np.asarray(top * (1 - y) + bottom * y, np.float32)


def test_the_inverse_warp_inverts_the_projection(shots: Shots, shape: ShapeFreeFrame) -> None:
    face = shots.faces[2]
    positions = shape.positions(face)
    seen = visible_texels(shape.atlas, face.pose, shots.face.animate(face.eau))
    pixels, texels = inverse_warp(shape, positions, seen, (240, 320))
    assert len(np.unique(pixels)) == len(pixels) > 5000
    grid = np.full((shape.atlas.size, shape.atlas.size, 2), np.nan, np.float32)
    grid[shape.atlas.rows, shape.atlas.columns] = positions
    there = sample_bilinear(grid, texels)
    expected = np.stack([pixels % 320, pixels // 320], 1)
    off = np.linalg.norm(there - expected, axis=1)
    assert np.nanmedian(off) < 0.05 and np.nanpercentile(off, 95) < 0.5


def test_a_back_projected_texture_reproduces_the_picture_better(
    shots: Shots, shape: ShapeFreeFrame, detailed: Picture
) -> None:
    face = shots.faces[3]
    positions = shape.positions(face)
    seen = visible_texels(shape.atlas, face.pose, shots.face.animate(face.eau))
    colours = sample_bicubic(detailed, positions)
    better = back_projected(shape, whole(detailed), positions, colours, seen)
    pixels, texels = inverse_warp(shape, positions, seen, (240, 320))
    wanted = detailed.reshape(-1, 3)[pixels].astype(np.float32)
    errors = [np.square(drawn(shape, c, texels) - wanted).mean() for c in (colours, better)]
    assert errors[1] < 0.6 * errors[0]
    assert np.array_equal(better[~seen], colours[~seen])


def test_a_uniform_picture_stays_uniform(shots: Shots, shape: ShapeFreeFrame) -> None:
    face = shots.faces[1]
    picture = np.full((240, 320, 3), 120, np.uint8)
    positions = shape.positions(face)
    colours = sample_bicubic(picture, positions)
    result = back_projected(shape, whole(picture), positions, colours, np.ones(len(shape), bool))
    # Pixels at the border of an island interpolate texels outside it, too.
    assert np.median(np.abs(result - 120)) < 0.01 and np.isfinite(result).all()


def test_luma_is_back_projected_as_colours_are(
    shots: Shots, shape: ShapeFreeFrame, detailed: Picture
) -> None:
    positions, seen = shape.positions(shots.faces[2]), np.ones(len(shape), bool)
    crop = whole(detailed)
    colours = back_projected(shape, crop, positions, sample_bicubic(detailed, positions), seen)
    luma = back_projected(
        shape, crop.as_luma, positions, sample_bicubic(crop.as_luma.picture, positions), seen
    )
    assert luma.shape == (len(shape), 1)
    assert np.median(np.abs(luma[:, 0] - to_luma(colours))) < 0.5
