"""Textures that draw right: sampling a picture and drawing the sample again interpolates twice.

Iterated back-projection (Irani & Peleg 1991): what the drawn texture lacks of the picture is
carried back to the texels it was drawn from, a few times.
"""

import numpy as np
from numpy.typing import NDArray

from encoder.crop import Crop
from encoder.shape_free import ShapeFree, spacing

Array = NDArray[np.float64]
Single = NDArray[np.float32]

ROUNDS = 4
STEP = 0.9
# A pixel onto which texels from further apart than this fall shows an edge between surfaces.
MOST_SCATTER_TEXELS = 2.5


def sharpened(
    shape: ShapeFree, crop: Crop, positions: Single, colours: Single, seen: NDArray[np.bool_]
) -> Single:
    """Colours (k, c) from which drawing gives the crop's pixels, near the sampled `colours` (k, c).

    positions: (k, 2) of the texels in the crop, pixels.  seen: (k,).
    """
    height, width = crop.picture.shape[:2]
    pixels, texels = pixel_texels(shape, positions, seen, (height, width))
    size = shape.atlas.size
    corners, shares = _bilinear(texels.T, size)
    weight = np.bincount(corners.ravel(), shares.ravel(), size * size)
    scale = STEP / np.maximum(weight, 0.3)
    result = colours.copy()
    channels = crop.picture.reshape(height * width, -1).take(pixels, axis=0).T
    for number, channel in enumerate(channels):
        texture = np.zeros(size * size, np.float32)
        texture[shape.place] = colours[:, number]
        for _ in range(ROUNDS):
            lack = channel - (shares * texture.take(corners)).sum(0)
            back = np.bincount(corners.ravel(), (shares * lack).ravel(), size * size)
            texture += scale * back
        result[:, number] = np.where(seen, texture.take(shape.place), colours[:, number])
    return result


def pixel_texels(
    shape: ShapeFree, positions: Single, seen: NDArray[np.bool_], size: tuple[int, int]
) -> tuple[NDArray[np.intp], Single]:
    """Which texel each pixel of the face shows: pixels (p,), texels (p, 2), column and row.

    Texels' places are averaged where they fall, then moved by one Newton step; pixels at the edges
    of surfaces are left out.
    """
    height, width = size
    atlas = shape.atlas
    u, v = positions.T
    inside = np.flatnonzero(seen & (u > 0) & (v > 0) & (u < width - 1) & (v < height - 1))
    at = np.stack([u[inside], v[inside]])
    column, row = (each[inside].astype(np.float64) for each in (atlas.columns, atlas.rows))
    square = column**2 + row**2
    low = np.floor(at).astype(np.intp)
    share = at - low
    count = height * width
    sums = np.zeros((4, count))
    for dx in (0, 1):
        for dy in (0, 1):
            w = np.abs(1 - dx - share[0]) * np.abs(1 - dy - share[1])
            pixel = (low[1] + dy) * width + low[0] + dx
            for total, value in zip(sums, (w, w * column, w * row, w * square), strict=True):
                total += np.bincount(pixel, value, count)
    pixels = np.flatnonzero(sums[0] > 0.5)
    weight, *moments = sums[:, pixels]
    x, y, squares = (moment / weight for moment in moments)
    scatter = squares - (x**2 + y**2)
    texels_each = np.sqrt(len(inside) / max(len(pixels), 1))
    smooth = np.flatnonzero(scatter < (MOST_SCATTER_TEXELS * max(texels_each, 1.0)) ** 2)
    return _newton(shape, positions, pixels[smooth], np.stack([x[smooth], y[smooth]]), width)


def _newton(
    shape: ShapeFree, positions: Single, pixels: NDArray[np.intp], texels: Array, width: int
) -> tuple[NDArray[np.intp], Single]:
    size = shape.atlas.size
    grid = shape.whole(positions)
    across, down = spacing(grid)
    column, row = nearest = np.rint(texels).astype(np.intp)
    at = row * size + column
    here, (ax, ay), (bx, by) = (
        each.reshape(2, -1).take(at, axis=1) for each in (grid, across, down)
    )
    ex, ey = np.stack([pixels % width, pixels // width]) - here
    area = ax * by - ay * bx
    step = np.stack([ex * by - ey * bx, ax * ey - ay * ex]) / area
    # What is not finite is not good, either.
    good = np.flatnonzero((np.abs(step) < MOST_SCATTER_TEXELS).all(0))
    found = np.clip((nearest + step).take(good, axis=1), 0, size - 1.001)
    return pixels[good], found.T.astype(np.float32)


def _bilinear(texels: Single, size: int) -> tuple[NDArray[np.intp], Single]:
    """Flat indices (4, p) and weights (4, p) of the texels around each place (2, p)."""
    low = np.floor(texels).astype(np.intp)
    x, y = texels - low
    corner = low[1] * size + low[0]
    corners = np.stack([corner, corner + 1, corner + size, corner + size + 1])
    shares = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    return corners, shares.astype(np.float32)
