"""Motion fields refined against the frames themselves: least squared error around the face.

One Gauss-Newton step for all displacements of all fields together, for given coefficients.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from encoder.layers.layer_fitter import LayerFitter
from encoder.layers.layer_samples import CoarseFrame, LayerSamples
from runtime.cauchy_weight import cauchy_weight
from runtime.jit import jit
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Indices, Single

# Weight of the squared difference between neighbouring points, and of the squared step, against
# the mean of the normal matrix' diagonal.
SMOOTHNESS, DAMPING = 0.05, 0.02
# Less than so many squared grey levels per pixel tell nothing.
MIN_SLOPE2 = 0.01


def refined_fields(
    fields_px: Array, samples: LayerSamples, fitter: LayerFitter, coefficients: Array
) -> Array:
    """(k, rows, columns, 2) source pixels per unit: the fields after one step.

    fields_px: the fields of `fitter`.  coefficients: (n, k or more) of the frames.
    """
    count, rows, columns = fields_px.shape[:3]
    points = rows * columns
    scale = np.sqrt((coefficients[:, :count] ** 2).mean(0)) + 1e-9
    normal = np.zeros((count, 2, points, count, 2, points))
    right = np.zeros((count, 2, points))
    to_source = (fitter.scene.shape[1] / samples.size[0], fitter.scene.shape[0] / samples.size[1])

    def equations(frame: tuple[CoarseFrame, Array]) -> tuple[Array, Array]:
        return _normal_equations(*frame, fitter, np.array(to_source), (rows, columns))

    frames = list(zip(samples.coarse_frames(), coefficients, strict=True))
    each = parallel_map(equations, frames, samples.workers)
    for own, (squares, products) in zip(coefficients, each, strict=True):
        unit = own[:count] / scale
        add_fields(normal, unit, squares, columns)
        right += unit[:, None, None] * products
    size = count * 2 * points
    matrix = normal.reshape(size, size)
    mean = float(np.trace(matrix)) / size
    if not mean:
        # The face covers all: nothing is seen to move around it.
        return fields_px
    roughness = np.kron(np.eye(count * 2), mean * SMOOTHNESS * _roughness(rows, columns))
    fields = (fields_px * scale[:, None, None, None]).transpose(0, 3, 1, 2).reshape(size)
    matrix = matrix + roughness + mean * DAMPING * np.eye(size)
    step = np.linalg.solve(matrix, right.reshape(size) - roughness @ fields)
    moved = (fields + step).reshape(count, 2, rows, columns).transpose(0, 2, 3, 1)
    return np.asarray(moved / scale[:, None, None, None])


def _normal_equations(
    frame: CoarseFrame, own: Array, fitter: LayerFitter, to_source: Array, grid: tuple[int, int]
) -> tuple[Array, Array]:
    """Of a frame whose coefficient is 1: (2, 2, points, points) and (2, points).

    to_source: (2,) coarse pixels per source pixel.
    """
    at = frame.origins
    drawn, gradient = fitter.sensitivity(at, own)
    residual = frame.luma - drawn
    weight = cauchy_weight(residual, weight=frame.outside)
    # Grey levels per source pixel of displacement.
    slope = -gradient * to_source
    used = np.flatnonzero((weight * (slope**2).sum(-1)).ravel() > MIN_SLOPE2)
    corners, shares = zip(*_corner_shares(at.reshape(-1, 2)[used], drawn.shape, grid), strict=True)
    slopes, weights = slope.reshape(-1, 2)[used], weight.ravel()[used]
    weighted = slopes * weights[:, None]
    points = grid[0] * grid[1]
    squares, products = np.zeros((2, 2, points, points)), np.zeros((2, points))
    errors = residual.ravel()[used]
    add_pixels(squares, products, np.array(corners), np.array(shares), weighted, slopes, errors)
    squares[1, 0] = squares[0, 1]
    return squares, products


@jit
def add_pixels(
    squares: Array,
    products: Array,
    corners: Indices,
    shares: Array,
    weighted: Array,
    slopes: Array,
    errors: Single,
) -> None:
    """Add m pixels to the equations, see `_normal_equations`; those of [1, 0] are left out.

    corners, shares: (4, m) see `_corner_shares`.  weighted: slopes (m, 2) times weights (m,).
    """
    points, pixels = products.shape[1], len(errors)
    for axis in range(2):
        for first in range(4):
            sums = np.zeros(points)
            for pixel in range(pixels):
                left = weighted[pixel, axis] * shares[first, pixel]
                sums[corners[first, pixel]] += left * errors[pixel]
            products[axis] += sums
            for other in range(axis, 2):
                for second in range(4):
                    # The second corner is as far from the first one for all pixels.
                    sums[:] = 0
                    for pixel in range(pixels):
                        left = weighted[pixel, axis] * shares[first, pixel]
                        value = left * slopes[pixel, other] * shares[second, pixel]
                        sums[corners[first, pixel]] += value
                    if pixels:
                        away = corners[second, 0] - corners[first, 0]
                        for point in range(max(0, -away), min(points, points - away)):
                            squares[axis, other, point, point + away] += sums[point]


@jit
def add_fields(normal: Array, unit: Array, squares: Array, columns: int) -> None:
    """Add a frame to the equations (k, 2, points, k, 2, points) of all fields.

    unit: (k,) its coefficients.  squares: (2, 2, points, points) of a field whose coefficient is 1;
    0 but for points next to each other, of a grid of so many columns.
    """
    count, points = len(unit), squares.shape[2]
    for k in range(count):
        for x in range(2):
            for p in range(points):
                for other in range(count):
                    for y in range(2):
                        for down in range(-1, 2):
                            middle = p + down * columns
                            for q in range(max(middle - 1, 0), min(middle + 2, points)):
                                value = squares[x, y, p, q] * unit[other] * unit[k]
                                normal[k, x, p, other, y, q] += value


def _corner_shares(
    at: Single, shape: tuple[int, ...], grid: tuple[int, int]
) -> Iterator[tuple[Indices, Array]]:
    """The four points around positions (m, 2), coarse pixels, and their linear weights."""
    last = np.array(grid[::-1]) - 1
    position = np.clip((at + 0.5) / np.array(shape[1::-1]) * last, 0, last - 1e-6)
    low = position.astype(np.intp)
    part = position - low
    for down, right in product((0, 1), (0, 1)):
        share = np.abs(1 - right - part[:, 0]) * np.abs(1 - down - part[:, 1])
        yield (low[:, 1] + down) * grid[1] + low[:, 0] + right, share


def _roughness(rows: int, columns: int) -> Array:
    """(points, points) of the sum of squared differences between neighbours."""
    number = np.arange(rows * columns).reshape(rows, columns)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    matrix = np.zeros((rows * columns,) * 2)
    for first, second in pairs:
        a, b = first.ravel(), second.ravel()
        np.add.at(matrix, (a, a), 1)
        np.add.at(matrix, (b, b), 1)
        np.add.at(matrix, (a, b), -1)
        np.add.at(matrix, (b, a), -1)
    return matrix
