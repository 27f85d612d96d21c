"""Sharp textures by iterated back-projection (Irani and Peleg 1991).

A texture sampled from a picture and drawn again has been interpolated twice, which blurs it.  The
difference between picture and drawn texture is added back to the texels, a few times.
"""

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame, texel_jacobian
from encoder.capture.face_crop import Crop
from runtime.bilinear import bilinear_weights
from runtime.jit import jit
from shared_model.arrays import Array, Indices, Mask, Single, VertexIndices

ITERATIONS = 4
RELAXATION = 0.9
# Least sum of bilinear weights by which a texel's correction is divided: texels that hardly any
# pixel shows change little.
MIN_WEIGHT = 0.3
# A pixel that texels from further apart fall onto lies at the edge of a surface and is left out.
MAX_SPREAD_TEXELS = 2.5


def back_projected(
    shape_free: ShapeFreeFrame,
    crop: Crop,
    positions: Single,
    colours: Single,
    visible: Mask,
) -> Single:
    """(k, c) texel colours whose drawing reproduces the crop.

    positions: (k, 2) of the texels in the crop, pixels.
    colours: (k, c) the first estimate, as sampled at `positions`.  visible: (k,); hidden texels
    keep their colours.
    """
    height, width = crop.picture.shape[:2]
    pixels, texels = inverse_warp(shape_free, positions, visible, (height, width))
    size = shape_free.atlas.size
    channels = crop.picture.shape[2] if crop.picture.ndim == 3 else 1
    target = crop.picture.reshape(height * width, channels).take(pixels, axis=0)
    target = target.astype(np.float32)
    texture = np.zeros((size * size, channels), np.float32)
    texture[shape_free.flat_index] = colours
    _back_project(texture, texels, size, target)
    return np.where(visible[:, None], texture.take(shape_free.flat_index, axis=0), colours)


@jit
def _back_project(texture: Single, texels: Single, size: int, target: Single) -> None:
    """Change a texture (size * size, channels) in place so that its drawing approaches `target`.

    target: (p, channels) the pixels.  texels: (p, 2) column and row that each pixel shows.
    """
    count, channels = texture.shape
    total = np.zeros(count, np.float32)
    for pixel in range(len(target)):
        first, a, b, c, d = bilinear_weights(texels[pixel, 0], texels[pixel, 1], size, size)
        total[first] += a
        total[first + 1] += b
        total[first + size] += c
        total[first + size + 1] += d
    scale = np.float32(RELAXATION) / np.maximum(total, np.float32(MIN_WEIGHT))
    for _ in range(ITERATIONS):
        correction = np.zeros_like(texture)
        for pixel in range(len(target)):
            first, a, b, c, d = bilinear_weights(texels[pixel, 0], texels[pixel, 1], size, size)
            for channel in range(channels):
                residual = target[pixel, channel] - (
                    a * texture[first, channel]
                    + b * texture[first + 1, channel]
                    + c * texture[first + size, channel]
                    + d * texture[first + size + 1, channel]
                )
                correction[first, channel] += a * residual
                correction[first + 1, channel] += b * residual
                correction[first + size, channel] += c * residual
                correction[first + size + 1, channel] += d * residual
        for texel in range(count):
            for channel in range(channels):
                texture[texel, channel] += scale[texel] * correction[texel, channel]


def inverse_warp(
    shape_free: ShapeFreeFrame, positions: Single, visible: Mask, size: tuple[int, int]
) -> tuple[Indices, Single]:
    """The texel that each pixel of the face shows.

    positions: (k, 2) of the texels, pixels.  visible: (k,).  size: (height, width) of the picture.
    Returns pixels (p,), row-major indices, and texels (p, 2), column and row.  The first estimate
    is the mean of the texels that fall around a pixel; a Newton step refines it.  Pixels at the
    edges of surfaces are left out.
    """
    height, width = size
    atlas = shape_free.atlas
    sums, inside = _splat(positions, atlas.columns, atlas.rows, visible, height, width)
    return _inverse(sums, inside, shape_free.to_grid(positions), width)


@jit
def _splat(
    positions: Single,
    columns: VertexIndices,
    rows: VertexIndices,
    visible: Mask,
    height: int,
    width: int,
) -> tuple[Array, int]:
    """(4, pixels) sums over the texels around each pixel, by bilinear weights: of 1, column, row
    and the squares of both; and the number of texels inside the picture."""
    sums = np.zeros((4, height * width))
    inside = 0
    for k in range(len(positions)):
        u, v = positions[k]
        if not (visible[k] and u > 0 and v > 0 and u < width - 1 and v < height - 1):
            continue
        inside += 1
        first, a, b, c, d = bilinear_weights(u, v, width, height)
        column, row = float(columns[k]), float(rows[k])
        square = column * column + row * row
        for pixel, weight in (
            (first, a),
            (first + 1, b),
            (first + width, c),
            (first + width + 1, d),
        ):
            sums[0, pixel] += weight
            sums[1, pixel] += weight * column
            sums[2, pixel] += weight * row
            sums[3, pixel] += weight * square
    return sums, inside


@jit
def _inverse(sums: Array, inside: int, grid: Single, width: int) -> tuple[Indices, Single]:
    """See `inverse_warp`.  sums, inside: of `_splat`.  grid: positions, see `warp_jacobian`."""
    size, count = grid.shape[1], 0
    pixels, texels = np.empty(sums.shape[1], np.intp), np.empty((sums.shape[1], 2), np.float32)
    covered = max((sums[0] > 0.5).sum(), 1)
    spread = (MAX_SPREAD_TEXELS * max(np.sqrt(inside / covered), 1.0)) ** 2
    for pixel in range(sums.shape[1]):
        weight = sums[0, pixel]
        if not weight > 0.5:
            continue
        x, y = sums[1, pixel] / weight, sums[2, pixel] / weight
        if not sums[3, pixel] / weight - (x * x + y * y) < spread:
            continue
        column, row = int(np.rint(x)), int(np.rint(y))
        ax, ay, bx, by = texel_jacobian(grid, row, column)
        ex, ey = pixel % width - grid[0, row, column], pixel // width - grid[1, row, column]
        determinant = ax * by - ay * bx
        right, down = (ex * by - ey * bx) / determinant, (ax * ey - ay * ex) / determinant
        # A step that is not finite fails the comparison, too.
        if abs(right) < MAX_SPREAD_TEXELS and abs(down) < MAX_SPREAD_TEXELS:
            pixels[count] = pixel
            texels[count, 0] = min(max(column + right, 0), size - 1.001)
            texels[count, 1] = min(max(row + down, 0), size - 1.001)
            count += 1
    return pixels[:count], texels[:count]
