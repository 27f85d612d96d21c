"""A plain painted face for the generic head: eyes, lips, brows, hair."""

from itertools import pairwise

import numpy as np

from decoder.rendering.render_geometry import part_colours
from shared_model.arrays import Array, Mask, Picture
from shared_model.mesh import OUTER_LIPS, PARTS, Head, inside_mouth

# BGR.
LIPS = (95, 95, 175)
HAIR = (35, 45, 65)
IRIS = (60, 85, 110)
PUPIL = (15, 15, 15)
IRIS_DEG, PUPIL_DEG = 20.0, 9.0
BROW_MM = 4.0
# Paint thins out over this width at its edge: about a triangle's, or else the mesh shows in it.
SOFT_MM = 4.0
# Inside the mouth light falls by this much for each mm behind the lips, down to the least.
DARKER_PER_MM, LEAST_LIGHT = 0.014, 0.25

# Points of the landmark network: the brows from the middle outwards.
BROWS = ((107, 66, 105, 63, 70), (336, 296, 334, 293, 300))


def painted_colours(head: Head, mottle: float = 0.0, seed: int = 0) -> Picture:
    """(n, 3) uint8 BGR of each vertex of a plain face.

    mottle: share by which the skin's brightness varies from vertex to vertex, so that a tracker
        finds something to hold on to; drawn from `seed`.
    """
    colours = part_colours(head).astype(np.float64)
    _paint(colours, HAIR, _hair(head))
    if mottle:
        spots = np.random.default_rng(seed).uniform(1 - mottle, 1 + mottle, (len(colours), 1))
        colours = np.where(_skin(head)[:, None], colours * spots, colours)
    _paint(colours, LIPS, _lips(head))
    _paint(colours, HAIR, _brows(head))
    colours *= _mouth_light(head)[:, None]
    for part in ("eye_left", "eye_right"):
        ball = np.flatnonzero(head.parts == PARTS.index(part))
        angle = _angle_from_axis(head.vertices[ball])
        colours[ball[angle < IRIS_DEG]] = IRIS
        colours[ball[angle < PUPIL_DEG]] = PUPIL
    return np.clip(np.rint(colours), 0, 255).astype(np.uint8)


def network_points(head: Head, index: tuple[int, ...]) -> Array:
    """(k, 3) mm: where points of the 468-point landmark network lie on the neutral head."""
    chosen = list(index)
    corners = head.vertices[head.triangles[head.network_triangles[chosen]]]
    return np.asarray((head.network_weights[chosen][..., None] * corners).sum(1))


def _skin(head: Head) -> Mask:
    return np.asarray(head.parts == PARTS.index("skin"))


def _paint(colours: Array, paint: tuple[int, int, int], within_mm: Array) -> None:
    """Lay paint on vertices that lie inside its outline by (n,) mm; soft at the edge."""
    share = np.clip(0.5 + within_mm / SOFT_MM, 0, 1)[:, None]
    colours += share * (np.array(paint) - colours)


def _lips(head: Head) -> Array:
    """(n,) mm inside the outline of the lips, seen from the front."""
    outline = network_points(head, OUTER_LIPS)
    x, y = head.vertices[:, 0], head.vertices[:, 1]
    inside = np.zeros(len(x), bool)
    for (ax, ay, _), (bx, by, _) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        crosses = (ay > y) != (by > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    away = _distance(head.vertices[:, :2], np.vstack([outline, outline[:1]])[:, :2])
    front = head.vertices[:, 2] > outline[:, 2].min() - 4
    return np.where(front & _skin(head), np.where(inside, away, -away), -np.inf)


def _hair(head: Head) -> Array:
    """(n,) mm inside a hairline that is highest in the middle, and goes behind the ears."""
    x, y, z = head.vertices.T
    tragion, top = head.vertices[head.landmarks["t_l"]], head.vertices[head.landmarks["tr"]]
    front = y - (top[1] + 4 - 0.006 * x**2)
    behind = np.minimum(tragion[2] - 22 - z, y - (tragion[1] - 55))
    above_ear = np.minimum(tragion[2] + 6 - z, y - (tragion[1] + 32))
    within = np.maximum(front, np.maximum(behind, above_ear))
    return np.where(_skin(head), within, -np.inf)


def _brows(head: Head) -> Array:
    """(n,) mm inside the brows: within `BROW_MM` of their upper edges."""
    away = [_distance(head.vertices, network_points(head, brow)) for brow in BROWS]
    return np.where(_skin(head), BROW_MM - np.min(away, axis=0), -np.inf)


def _mouth_light(head: Head) -> Array:
    """(n,) what light is left: 1 outside the mouth, less the deeper inside."""
    behind_mm = head.vertices[head.landmarks["sto"], 2] - head.vertices[:, 2]
    inside = inside_mouth(head)
    return np.where(inside, np.clip(1 - DARKER_PER_MM * behind_mm, LEAST_LIGHT, 1), 1)


def _distance(points: Array, line: Array) -> Array:
    """(n,) from points (n, d) to the nearest place on a line of points (k, d)."""
    nearest = np.full(len(points), np.inf)
    for a, b in pairwise(line):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        away = np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
        nearest = np.minimum(nearest, away)
    return nearest


def _angle_from_axis(ball: Array) -> Array:
    """(k,) degrees from the forward axis through the middle of an eyeball's vertices."""
    side = ball[:, :2].mean(0)
    radius = float(np.ptp(ball[:, 0])) / 2
    away = np.linalg.norm(ball[:, :2] - side, axis=1)
    return np.asarray(np.degrees(np.arcsin(np.clip(away / radius, 0, 1))))
