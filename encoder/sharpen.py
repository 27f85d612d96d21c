"""Textures that draw right: sampling a picture and drawing the sample again interpolates twice.

Iterated back-projection (Irani & Peleg 1991): what the drawn texture lacks of the picture is
carried back to the texels it was drawn from, a few times.
"""

import numpy as np
from numpy.typing import NDArray

from encoder.crop import Crop
from encoder.shape_free import ShapeFree

Array = NDArray[np.float64]
Single = NDArray[np.float32]

ROUNDS = 4
STEP = 0.9
# A pixel onto which texels from further apart than this fall shows an edge between surfaces.
MOST_SCATTER_TEXELS = 2.5


def sharpened(
    shape: ShapeFree, crop: Crop, positions: Single, colours: Single, seen: NDArray[np.bool_]
) -> Single:
    """Colours (k, 3) from which drawing gives the crop's pixels, near the sampled `colours` (k, 3).

    positions: (k, 2) of the texels in the crop, pixels.  seen: (k,).
    """
    height, width = crop.picture.shape[:2]
    pixels, texels = pixel_texels(shape, positions, seen, (height, width))
    atlas, size = shape.atlas, shape.atlas.size
    image = np.zeros((size, size, 3), np.float32)
    image[atlas.rows, atlas.columns] = colours
    wanted = crop.picture.reshape(-1, 3)[pixels].astype(np.float32)
    corners, shares = _bilinear(texels, size)
    weight = np.bincount(corners.ravel(), shares.ravel(), size * size)
    flat = image.reshape(-1, 3)
    scale = STEP / np.maximum(weight, 0.3)
    for _ in range(ROUNDS):
        drawn = np.einsum("pc,pcd->pd", shares, flat[corners])
        lack = wanted - drawn
        for channel in range(3):
            back = shares * lack[:, None, channel]
            flat[:, channel] += scale * np.bincount(corners.ravel(), back.ravel(), size * size)
    result = flat.reshape(size, size, 3)[atlas.rows, atlas.columns]
    return np.asarray(np.where(seen[:, None], result, colours), np.float32)


def pixel_texels(
    shape: ShapeFree, positions: Single, seen: NDArray[np.bool_], size: tuple[int, int]
) -> tuple[NDArray[np.intp], Single]:
    """Which texel each pixel of the face shows: pixels (p,), texels (p, 2), column and row.

    Texels' places are averaged where they fall, then moved by one Newton step; pixels at the edges
    of surfaces are left out.
    """
    height, width = size
    atlas = shape.atlas
    inside = seen & (positions > 0).all(1) & (positions < np.array([width - 1, height - 1])).all(1)
    at = positions[inside]
    places = np.stack([atlas.columns[inside], atlas.rows[inside]], 1).astype(np.float64)
    low = np.floor(at).astype(np.intp)
    share = at - low
    count = height * width
    sums = np.zeros((count, 4))
    for dx in (0, 1):
        for dy in (0, 1):
            w = np.abs(1 - dx - share[:, 0]) * np.abs(1 - dy - share[:, 1])
            pixel = (low[:, 1] + dy) * width + low[:, 0] + dx
            sums[:, 0] += np.bincount(pixel, w, count)
            for axis in (0, 1):
                sums[:, 1 + axis] += np.bincount(pixel, w * places[:, axis], count)
            sums[:, 3] += np.bincount(pixel, w * (places**2).sum(1), count)
    pixels = np.flatnonzero(sums[:, 0] > 0.5)
    mean = sums[pixels, 1:3] / sums[pixels, :1]
    scatter = sums[pixels, 3] / sums[pixels, 0] - (mean**2).sum(1)
    spacing = np.sqrt(len(at) / max(len(pixels), 1))
    smooth = scatter < (MOST_SCATTER_TEXELS * max(spacing, 1.0)) ** 2
    return _newton(shape, positions, pixels[smooth], mean[smooth], width)


def _newton(
    shape: ShapeFree, positions: Single, pixels: NDArray[np.intp], texels: Array, width: int
) -> tuple[NDArray[np.intp], Single]:
    atlas, size = shape.atlas, shape.atlas.size
    grid = np.full((size, size, 2), np.nan, np.float32)
    grid[atlas.rows, atlas.columns] = positions
    across, down = (np.asarray(np.gradient(grid, axis=axis)) for axis in (1, 0))
    nearest = np.rint(texels).astype(np.intp)
    column, row = nearest[:, 0], nearest[:, 1]
    target = np.stack([pixels % width, pixels // width], 1)
    here, a, b = grid[row, column], across[row, column], down[row, column]
    error = target - here
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    du = (error[:, 0] * b[:, 1] - error[:, 1] * b[:, 0]) / area
    dv = (a[:, 0] * error[:, 1] - a[:, 1] * error[:, 0]) / area
    step = np.stack([du, dv], 1)
    good = np.isfinite(step).all(1) & (np.abs(step) < MOST_SCATTER_TEXELS).all(1)
    found = np.clip(nearest[good] + step[good], 0, size - 1.001)
    return pixels[good], found.astype(np.float32)


def _bilinear(texels: Single, size: int) -> tuple[NDArray[np.intp], Single]:
    """Flat indices (p, 4) and weights (p, 4) of the texels around each place."""
    low = np.floor(texels).astype(np.intp)
    share = texels - low
    x, y = share[:, 0], share[:, 1]
    corner = low[:, 1] * size + low[:, 0]
    corners = np.stack([corner, corner + 1, corner + size, corner + size + 1], 1)
    shares = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], 1)
    return corners, shares.astype(np.float32)
