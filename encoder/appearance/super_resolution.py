"""Textures that draw right: sampling a picture and drawing the sample again interpolates twice.

Iterated back-projection (Irani & Peleg 1991): what the drawn texture lacks of the picture is
carried back to the texels it was drawn from, a few times.
"""

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFree, spacing
from encoder.capture.face_crop import Crop
from encoder.runtime.jit import compiled

Array = NDArray[np.float64]
Single = NDArray[np.float32]

ROUNDS = 4
STEP = 0.9
# A texel that hardly shows is not changed by more than what little it shows says.
LEAST_WEIGHT = 0.3
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
    channels = crop.picture.shape[2] if crop.picture.ndim == 3 else 1
    wanted = crop.picture.reshape(height * width, channels).take(pixels, axis=0)
    texture = np.zeros((size * size, channels), np.float32)
    texture[shape.place] = colours
    _carry_back(texture, corners, shares, wanted)
    return np.where(seen[:, None], texture.take(shape.place, axis=0), colours)


@compiled
def _carry_back(
    texture: Single, corners: NDArray[np.intp], shares: Single, wanted: NDArray[np.generic]
) -> None:
    """Change a texture (n, channels) until what is drawn of it is nearer to `wanted` (p, channels).

    corners, shares: (4, p), see `_bilinear`.
    """
    count, channels = texture.shape
    weight = np.zeros(count, np.float32)
    for corner in range(4):
        for pixel in range(len(wanted)):
            weight[corners[corner, pixel]] += shares[corner, pixel]
    scale = np.float32(STEP) / np.maximum(weight, np.float32(LEAST_WEIGHT))
    for _ in range(ROUNDS):
        back = np.zeros_like(texture)
        for pixel in range(len(wanted)):
            a, b, c, d = corners[:, pixel]
            wa, wb, wc, wd = shares[:, pixel]
            for channel in range(channels):
                lack = np.float32(wanted[pixel, channel]) - (
                    wa * texture[a, channel]
                    + wb * texture[b, channel]
                    + wc * texture[c, channel]
                    + wd * texture[d, channel]
                )
                back[a, channel] += wa * lack
                back[b, channel] += wb * lack
                back[c, channel] += wc * lack
                back[d, channel] += wd * lack
        for texel in range(count):
            for channel in range(channels):
                texture[texel, channel] += scale[texel] * back[texel, channel]


def pixel_texels(
    shape: ShapeFree, positions: Single, seen: NDArray[np.bool_], size: tuple[int, int]
) -> tuple[NDArray[np.intp], Single]:
    """Which texel each pixel of the face shows: pixels (p,), texels (p, 2), column and row.

    Texels' places are averaged where they fall, then moved by one Newton step; pixels at the edges
    of surfaces are left out.
    """
    height, width = size
    atlas = shape.atlas
    sums, inside = _gathered(positions, atlas.columns, atlas.rows, seen, height, width)
    pixels = np.flatnonzero(sums[0] > 0.5)
    weight, *moments = sums[:, pixels]
    x, y, squares = (moment / weight for moment in moments)
    scatter = squares - (x**2 + y**2)
    texels_each = np.sqrt(inside / max(len(pixels), 1))
    smooth = np.flatnonzero(scatter < (MOST_SCATTER_TEXELS * max(texels_each, 1.0)) ** 2)
    return _newton(shape, positions, pixels[smooth], np.stack([x[smooth], y[smooth]]), width)


@compiled
def _gathered(
    positions: Single,
    columns: NDArray[np.int32],
    rows: NDArray[np.int32],
    seen: NDArray[np.bool_],
    height: int,
    width: int,
) -> tuple[Array, int]:
    """(4, pixels) sums over the texels that fall near: shares, column, row, squares of both.

    Also how many texels fell into the picture.
    """
    sums = np.zeros((4, height * width))
    inside = 0
    for k in range(len(positions)):
        u, v = positions[k]
        if not (seen[k] and u > 0 and v > 0 and u < width - 1 and v < height - 1):
            continue
        inside += 1
        left, top = int(u), int(v)
        x, y = u - left, v - top
        column, row = float(columns[k]), float(rows[k])
        square = column * column + row * row
        for dy in range(2):
            for dx in range(2):
                share = abs(1 - dx - x) * abs(1 - dy - y)
                pixel = (top + dy) * width + left + dx
                sums[0, pixel] += share
                sums[1, pixel] += share * column
                sums[2, pixel] += share * row
                sums[3, pixel] += share * square
    return sums, inside


def _newton(
    shape: ShapeFree, positions: Single, pixels: NDArray[np.intp], texels: Array, width: int
) -> tuple[NDArray[np.intp], Single]:
    size = shape.atlas.size
    grid = shape.whole(positions)
    column, row = nearest = np.rint(texels).astype(np.intp)
    at = row * size + column
    here, (ax, ay, bx, by) = grid.reshape(2, -1).take(at, axis=1), spacing(grid, at)
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
