"""Turn the network's answers in several views into places on the neutral mesh."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from assets.head_asset.mesh_parts import SKIN, Mesh
from assets.head_asset.network import CAMERA, POINTS, Sight, see
from encoder.detection.landmarks import FaceMesh
from shared_model.arrays import Array, Integers, Mask
from shared_model.geometry import camera_from_head, pixel_from_head
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

# Inner rims of the lips, from the subject's right corner to the left one, corners left out.
INNER_UPPER = (191, 80, 81, 82, 13, 312, 311, 310, 415)
INNER_LOWER = (95, 96, 88, 178, 87, 14, 317, 402, 318, 324, 325)
# (yaw, pitch) in degrees, share of the jawOpen target.
VIEWS = (
    *((yaw, 0, 0.0) for yaw in (-30, -20, -10, 0, 10, 20, 30)),
    *((yaw, pitch, 0.0) for yaw in (-12, 0, 12) for pitch in (-12, 12)),
)
# Full jawOpen lowers the lower lip by more than this, mm, and the upper by less.
LOWER_LIP_MM = -9.0
# How far above and below an inner rim's point the line between the lips is looked for, pixels.
RIM_SEARCH_PX = 16
OPEN_VIEWS = ((-12, 0, 0.35), (0, 0, 0.35), (12, 0, 0.35), (0, 10, 0.25), (0, -10, 0.25))


@dataclass(frozen=True, slots=True)
class Correspondence:
    """triangle: (468,) int64.  weights: (468, 3).  mirror: (468,) int64, left-right pairs."""

    triangle: Integers
    weights: Array
    mirror: Integers

    def places(self, vertices: Array, triangles: NDArray[np.integer]) -> Array:
        """(468, 3) mm where the points lie when the vertices are (n, 3)."""
        return np.asarray((self.weights[..., None] * vertices[triangles[self.triangle]]).sum(1))


def find_points(networks: Sequence[FaceMesh], mesh: Mesh) -> Correspondence:
    """Where each of the networks' points lies on the neutral mesh: their middle, made symmetric."""
    inner = _lip_groups() > 0
    lower_lip = _below_the_lips(mesh)
    skin = mesh.parts[mesh.triangles[:, 0]] == SKIN
    frontal = see(networks, mesh, mesh.vertices, 0, 0)
    place_in_front = _lift(mesh, frontal, frontal.answers[0], skin, lower_lip)[0]
    places, trust = [], []
    seen = np.zeros(len(mesh.triangles), bool)
    for yaw, pitch, jaw in (*VIEWS, *OPEN_VIEWS):
        sight = see(networks, mesh, mesh.vertices + jaw * mesh.targets["jawOpen"], yaw, pitch)
        seen[np.unique(sight.hits.triangle[sight.hits.triangle >= 0])] = True
        for points in sight.answers:
            place, weight = _lift(mesh, sight, points, skin, lower_lip)
            places.append(place)
            # An open mouth moves all that is below the nose, but only it shows the inner rims.
            trust.append(weight * (inner == (jaw > 0)) * _near_side(place_in_front, yaw))
    middle = robust_mean(np.array(places), np.array(trust))
    middle[inner] = _on_the_rims(middle, mesh, frontal, lower_lip)[inner]
    mirror = mirror_pairs(middle)
    middle = (middle + middle[mirror] * [-1, 1, 1]) / 2
    return _nearest(middle, mirror, mesh, seen)


def transfer(found: Correspondence, full: Mesh, thin: Mesh) -> Correspondence:
    """The same places on a thinner mesh."""
    everywhere = np.ones(len(thin.triangles), bool)
    return _nearest(found.places(full.vertices, full.triangles), found.mirror, thin, everywhere)


def _nearest(places: Array, mirror: Integers, mesh: Mesh, usable: Mask) -> Correspondence:
    """Nearest places on outward skin, rims on their own lip; the right side copies the left."""
    lower_lip = _below_the_lips(mesh)
    skin = usable & (mesh.parts[mesh.triangles[:, 0]] == SKIN) & _outward(mesh)
    allowed = {0: skin, 1: skin & ~lower_lip, 2: skin & lower_lip}
    group = _lip_groups()
    triangle, weights = np.zeros(POINTS, np.int64), np.zeros((POINTS, 3))
    for point in range(POINTS):
        mask = allowed[int(group[point])]
        triangle[point], weights[point] = closest_point(
            places[point], mesh.vertices, mesh.triangles, mask
        )
    index = {tuple(sorted(face)): i for i, face in enumerate(mesh.triangles.tolist())}
    for point in map(int, np.flatnonzero((places[:, 0] < 0) & (mirror != np.arange(POINTS)))):
        twin = int(mirror[point])
        corners = mesh.mirror[mesh.triangles[triangle[twin]]].tolist()
        triangle[point] = index[tuple(sorted(corners))]
        order = [corners.index(v) for v in mesh.triangles[triangle[point]].tolist()]
        weights[point] = weights[twin][order]
    return Correspondence(triangle, weights, mirror)


def _lip_groups() -> Integers:
    """(468,) 1 for the inner rim of the upper lip, 2 of the lower, 0 for all else."""
    group = np.zeros(POINTS, np.int64)
    group[list(INNER_UPPER)], group[list(INNER_LOWER)] = 1, 2
    return group


def _below_the_lips(mesh: Mesh) -> Mask:
    """Which triangles move with the jaw: tells the lower lip from the upper, which it touches."""
    return np.asarray(mesh.targets["jawOpen"][mesh.triangles][:, :, 1].mean(1) < LOWER_LIP_MM)


def _outward(mesh: Mesh) -> Mask:
    """Which triangles do not face back into the head."""
    corners = mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(normal[:, 2] > -0.4 * np.linalg.norm(normal, axis=1))


def robust_mean(places: Array, trust: Array) -> Array:
    """Weighted mean (k, 3) over views (v, k, 3) without those far from the median."""
    # Points at the silhouette of most views are known from the few that show them well.
    trust = np.where(trust > 0.25 * trust.max(0), trust, 0)
    usable = np.where((trust > 0)[..., None], places, np.nan)
    away = np.linalg.norm(places - np.nanmedian(usable, axis=0), axis=-1)
    limit = np.maximum(2 * np.nanmedian(np.where(trust > 0, away, np.nan), axis=0), 1.0)
    weight = trust * (away <= limit)
    return np.asarray((places * weight[..., None]).sum(0) / weight.sum(0)[:, None])


def mirror_pairs(points: Array) -> Integers:
    """(k,) which point is each one's mirror image in x.  Raises ValueError if pairs disagree."""
    cost = np.linalg.norm(points[:, None] * [-1, 1, 1] - points[None], axis=-1)
    mirror = linear_sum_assignment(cost + cost.T)[1]
    if not np.array_equal(mirror[mirror], np.arange(len(points))):
        raise ValueError("the network's points do not pair up left and right")
    return np.asarray(mirror)


def closest_point(
    point: Array, vertices: Array, triangles: NDArray[np.integer], allowed: Mask
) -> tuple[int, Array]:
    """The triangle and weights (3,) nearest to a point (3,) among the allowed triangles."""
    candidates = np.flatnonzero(allowed)
    weights = _closest_weights(point, vertices[triangles[candidates]])
    place = (weights[..., None] * vertices[triangles[candidates]]).sum(1)
    best = int(np.argmin(((place - point) ** 2).sum(1)))
    return int(candidates[best]), np.asarray(weights[best])


def _closest_weights(point: Array, corners: Array) -> Array:
    """(m, 3) weights of the nearest point of each triangle: inside, else on the best edge."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, point - a
    d00, d01, d11 = (ab * ab).sum(1), (ab * ac).sum(1), (ac * ac).sum(1)
    d20, d21 = (ap * ab).sum(1), (ap * ac).sum(1)
    scale = np.maximum(d00 * d11 - d01 * d01, 1e-12)
    wb, wc = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    weights = np.stack([1 - wb - wc, wb, wc], 1)
    inside = np.asarray((weights >= 0).all(1))
    best = np.full(len(corners), np.inf)
    edge_weights = np.zeros_like(weights)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, j] - corners[:, i]
        s = np.clip(
            ((point - corners[:, i]) * edge).sum(1) / np.maximum((edge * edge).sum(1), 1e-12), 0, 1
        )
        away = ((corners[:, i] + s[:, None] * edge - point) ** 2).sum(1)
        better = away < best
        best = np.where(better, away, best)
        row = np.zeros_like(weights)
        row[:, i], row[:, j] = 1 - s, s
        edge_weights = np.where(better[:, None], row, edge_weights)
    return np.asarray(np.where(inside[:, None], weights, edge_weights))


def _lift(
    mesh: Mesh, sight: Sight, points: Array, skin: Mask, lower_lip: Mask
) -> tuple[Array, Array]:
    """Places (468, 3) on the neutral mesh, and trust (468,), of points (468, 2) in a view."""
    triangle = sight.hits.triangle
    on_skin: Mask = np.logical_and(triangle >= 0, skin[triangle])
    masks = {
        0: on_skin,
        1: on_skin & ~lower_lip[triangle],
        2: on_skin & lower_lip[triangle],
    }
    group = _lip_groups()
    place, trust = np.zeros((POINTS, 3)), np.zeros(POINTS)
    normals = vertex_normals(sight.vertices, mesh.triangles)
    rays = camera_from_head(sight.pose, sight.vertices)
    for g, mask in masks.items():
        rows, columns = np.nonzero(mask)
        for point in np.flatnonzero(group == g):
            away = (columns - points[point, 0]) ** 2 + (rows - points[point, 1]) ** 2
            best = int(np.argmin(away))
            pixel = rows[best], columns[best]
            corners, w = mesh.triangles[triangle[pixel]], sight.hits.weights[pixel]
            place[point] = w @ mesh.vertices[corners]
            facing = _facing(w @ normals[corners], w @ rays[corners], sight)
            # Snapped points (away > 1 px) lie beyond the silhouette: almost no say.  Rims of lips
            # face up or down wherever they are seen from.
            slant = 1.0 if g else max(facing, 0.02) ** 2
            trust[point] = slant / (1 + max(away[best] - 2, 0))
    return place, trust


def _on_the_rims(places: Array, mesh: Mesh, frontal: Sight, lower_lip: Mask) -> Array:
    """Inner rims (468, 3) mm put where the closed lips meet as seen from the front, at the same x.

    There a closed mouth has both; an open one parts them there.
    """
    moved = places.copy()
    triangle, group = frontal.hits.triangle, _lip_groups()
    pixels = np.rint(pixel_from_head(CAMERA, frontal.pose, places)).astype(int)
    for point in np.flatnonzero(group):
        column, row = pixels[point]
        # The first row of the lower lip, looking down from well above the line.
        rows = np.arange(row - RIM_SEARCH_PX, row + RIM_SEARCH_PX)
        first = rows[np.argmax(lower_lip[triangle[rows, column]])]
        pixel = (first - 1 if group[point] == 1 else first), column
        corners = mesh.triangles[triangle[pixel]]
        moved[point] = frontal.hits.weights[pixel] @ mesh.vertices[corners]
    return moved


def _near_side(place: Array, yaw_deg: float) -> Array:
    """(468,) 0 for points of the half of the face that a turned head hides.

    place: (468, 3) mm.  A silhouette hides the points behind it: the network puts them on the edge.
    """
    side = np.clip(place[:, 0] / 40, -1, 1)
    return np.asarray(np.clip(1 - side * yaw_deg / 15, 0, 1))


def _facing(normal: Array, ray: Array, sight: Sight) -> float:
    turned = camera_from_head(Pose(sight.pose.rotation, np.zeros(3)), normal)
    return float(-(turned @ ray) / (np.linalg.norm(turned) * np.linalg.norm(ray)))
