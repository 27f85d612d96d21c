"""Flatten the left half of the face into half a rectangle without a fold.

The energy is the symmetric Dirichlet energy against each triangle's own shape, enlarged or shrunk
by the texel density wanted there; it is infinite at a flip, so a valid start stays valid
(Smith and Schaefer, "Bijective parameterization with free boundaries", 2015).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from shared_model.arrays import Array, Integers

# How much keeping the border apart from itself counts beside the chart.
FENCE_WEIGHT = 1e-4


@dataclass(frozen=True, slots=True)
class HalfChart:
    """A disc of triangles whose seam lies on u = 0.

    triangles: (m, 3) int64, counter-clockwise with u to the right and height upwards.
    shapes: (m, 2, 2) float64: edges b - a and c - a (columns) of each triangle as wanted.
    weights: (m,) float64: how much a triangle's distortion counts beside its area.
    seam: vertices on u = 0 from top to bottom.
    rim: vertices of the outer boundary from the seam's bottom to its top.
    """

    triangles: Integers
    shapes: Array
    weights: Array
    seam: Integers
    rim: Integers


def flat_shapes(corners: Array, scale: Array) -> Array:
    """(m, 2, 2) triangles (m, 3, 3) laid into the plane and scaled by (m,)."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.maximum(np.linalg.norm(ab, axis=1), 1e-9)
    along = (ab * ac).sum(1) / length
    across = np.linalg.norm(np.cross(ab, ac), axis=1) / length
    # A needle would pin its neighbours: give every triangle some height.
    across = np.maximum(across, 0.15 * length)
    shapes = np.zeros((len(corners), 2, 2))
    shapes[:, 0, 0], shapes[:, 0, 1], shapes[:, 1, 1] = length, along, across
    return np.asarray(shapes * scale[:, None, None])


def flatten(chart: HalfChart, width: float, height: float, fill: float = 1.3) -> Array:
    """(n, 2) coordinates in [0, width] x [0, height] of the chart's vertices (unused ones 0).

    fill: area of the wanted shapes over the rectangle's; above 1 it is pressed into the corners.
    """
    used, local = np.unique(chart.triangles, return_inverse=True)
    triangles = local.reshape(-1, 3)
    place = {int(v): i for i, v in enumerate(used)}
    seam = np.array([place[int(v)] for v in chart.seam])
    rim = np.array([place[int(v)] for v in chart.rim])
    area = np.linalg.det(chart.shapes) / 2
    shapes = chart.shapes * np.sqrt(fill * width * height / area.sum())
    start = _tutte(triangles, seam, rim, len(used), width, height)
    chain = np.concatenate([seam[-1:], rim, seam[:1]])
    start, fence = _fence(start, chain, width, height)
    weights = np.linalg.det(shapes) / 2 * chart.weights
    half = _Relaxation(
        np.concatenate([triangles, fence]),
        np.concatenate([shapes, _edges(start, fence)]),
        np.concatenate([weights, np.full(len(fence), FENCE_WEIGHT * weights.sum() / len(fence))]),
        *_bounds(start, len(used), seam, width, height),
    )
    flat = half.run(start)[: len(used)]
    out = np.zeros((int(chart.triangles.max()) + 1, 2))
    out[used] = flat
    return out


def _tutte(
    triangles: Integers, seam: Integers, rim: Integers, count: int, width: float, height: float
) -> Array:
    """Tutte's embedding into half an ellipse."""
    fixed = np.zeros((count, 2))
    fixed[seam, 1] = np.linspace(0.98, 0.02, len(seam)) * height
    turn = np.linspace(-np.pi / 2, np.pi / 2, len(rim) + 2)[1:-1]
    fixed[rim] = np.stack([np.cos(turn) * 0.98 * width, (0.5 + 0.48 * np.sin(turn)) * height], 1)
    on_border = np.zeros(count, bool)
    on_border[np.concatenate([seam, rim])] = True
    links = np.zeros((count, count))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        links[triangles[:, i], triangles[:, j]] = links[triangles[:, j], triangles[:, i]] = 1
    matrix = np.diag(links.sum(1)) - links
    inner = ~on_border
    flat = fixed.copy()
    right = -matrix[inner][:, on_border] @ fixed[on_border]
    flat[inner] = np.linalg.solve(matrix[inner][:, inner], right)
    return flat


def _fence(start: Array, chain: Integers, width: float, height: float) -> tuple[Array, Integers]:
    """Triangles from the chart's border to points just outside the rectangle, which are appended.

    As no triangle may flip, they keep the border from running into itself.
    """
    centre = np.array([0.0, height / 2])
    ray = start[chain] - centre
    reach = np.maximum(np.abs(ray[:, 0]) / width, np.abs(ray[:, 1]) / (height / 2))
    posts = centre + ray / reach[:, None] * 1.04
    outer = len(start) + np.arange(len(chain))
    first = np.stack([chain[:-1], outer[:-1], outer[1:]], 1)
    second = np.stack([chain[:-1], outer[1:], chain[1:]], 1)
    return np.concatenate([start, posts]), np.concatenate([first, second])


def _edges(flat: Array, triangles: Integers) -> Array:
    """(m, 2, 2) edges b - a and c - a of flat triangles."""
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    return np.stack([b - a, c - a], axis=-1)


def _bounds(
    start: Array, free: int, seam: Integers, width: float, height: float
) -> tuple[Array, Array]:
    """Lowest and highest coordinates: vertices in the rectangle, seam on u = 0, posts fixed."""
    low, high = np.zeros_like(start), np.tile([width, height], (len(start), 1))
    high[seam, 0] = 0.0
    low[free:] = high[free:] = start[free:]
    return low, high


@dataclass(frozen=True, slots=True)
class _Relaxation:
    """Triangles, the shapes (m, 2, 2) they want, their weights (m,), and bounds (n, 2)."""

    triangles: Integers
    shapes: Array
    weights: Array
    low: Array
    high: Array

    def run(self, start: Array) -> Array:
        inverse = np.asarray(np.linalg.inv(self.shapes), np.float64)
        weights = self.weights / self.weights.sum()
        bounds = np.stack([self.low.ravel(), self.high.ravel()], 1)

        def energy(flat: Array) -> tuple[float, Array]:
            value, gradient = dirichlet(flat.reshape(-1, 2), self.triangles, inverse, weights)
            return value, gradient.ravel()

        flat = start.ravel()
        # Restarts: the quasi-Newton memory is worthless after the first, violent moves.
        for steps in (200, 400, 800, 1500):
            options = {"maxiter": steps, "maxfun": 4 * steps, "maxcor": 30, "ftol": 1e-9}
            flat = minimize(
                energy, flat, jac=True, bounds=bounds, method="L-BFGS-B", options=options
            ).x
        return np.asarray(flat.reshape(-1, 2))


def dirichlet(flat: Array, triangles: Integers, inverse: Array, area: Array) -> tuple[float, Array]:
    """Symmetric Dirichlet energy, and its gradient (n, 2); huge where a triangle is flipped."""
    edges = _edges(flat, triangles)
    det_edges = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    if det_edges.min() <= 1e-12:
        return 1e12, np.zeros_like(flat)
    jacobian = edges @ inverse
    det = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    norm = (jacobian**2).sum((1, 2))
    # In the plane |J^-1|^2 = |J|^2 / det^2.
    value = float((area * norm * (1 + 1 / det**2)).sum())
    cofactor = np.empty_like(jacobian)
    cofactor[:, 0, 0], cofactor[:, 1, 1] = jacobian[:, 1, 1], jacobian[:, 0, 0]
    cofactor[:, 0, 1], cofactor[:, 1, 0] = -jacobian[:, 1, 0], -jacobian[:, 0, 1]
    slope = 2 * (1 + 1 / det**2)[:, None, None] * jacobian
    slope -= (2 * norm / det**3)[:, None, None] * cofactor
    edge_slope = area[:, None, None] * slope @ inverse.transpose(0, 2, 1)
    gradient = np.zeros_like(flat)
    np.add.at(gradient, triangles[:, 1], edge_slope[:, :, 0])
    np.add.at(gradient, triangles[:, 2], edge_slope[:, :, 1])
    np.add.at(gradient, triangles[:, 0], -edge_slope.sum(2))
    return value, gradient
