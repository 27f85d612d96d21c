"""A plain painted face for the head that wears no caller's texture: eyes, lips, brows, hair."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from decoder.render import part_colours
from shared_model.mesh import PARTS, Head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# BGR.
LIPS = (95, 95, 175)
HAIR = (35, 45, 65)
IRIS = (60, 85, 110)
PUPIL = (15, 15, 15)
IRIS_DEG, PUPIL_DEG = 20.0, 9.0
BROW_MM = 4.0

# Points of the landmark network: the outer edge of the lips; the brows from the middle outwards.
OUTER_LIPS = (
    61,
    185,
    40,
    39,
    37,
    0,
    267,
    269,
    270,
    409,
    291,
    375,
    321,
    405,
    314,
    17,
    84,
    181,
    91,
    146,
)
BROWS = ((107, 66, 105, 63, 70), (336, 296, 334, 293, 300))


def painted_colours(head: Head, mottle: float = 0.0, seed: int = 0) -> Picture:
    """(n, 3) uint8 BGR of each vertex of a plain face.

    mottle: share by which the skin's brightness varies from vertex to vertex, so that a tracker
        finds something to hold on to; drawn from `seed`.
    """
    colours = part_colours(head)
    colours[_hair(head)] = HAIR
    if mottle:
        spots = np.random.default_rng(seed).uniform(1 - mottle, 1 + mottle, (len(colours), 1))
        spotted = np.clip(np.rint(colours * spots), 0, 255).astype(np.uint8)
        colours = np.where(_skin(head)[:, None], spotted, colours)
    colours[_lips(head)] = LIPS
    colours[_brows(head)] = HAIR
    for part in ("eye_left", "eye_right"):
        ball = np.flatnonzero(head.parts == PARTS.index(part))
        angle = _angle_from_axis(head.vertices[ball])
        colours[ball[angle < IRIS_DEG]] = IRIS
        colours[ball[angle < PUPIL_DEG]] = PUPIL
    return colours


def network_points(head: Head, index: tuple[int, ...]) -> Array:
    """(k, 3) mm: where points of the 468-point landmark network lie on the neutral head."""
    chosen = list(index)
    corners = head.vertices[head.triangles[head.network_triangles[chosen]]]
    return np.asarray((head.network_weights[chosen][..., None] * corners).sum(1))


def _skin(head: Head) -> NDArray[np.bool_]:
    return np.asarray(head.parts == PARTS.index("skin"))


def _lips(head: Head) -> NDArray[np.bool_]:
    """(n,) inside the outline of the lips, seen from the front."""
    outline = network_points(head, OUTER_LIPS)
    x, y = head.vertices[:, 0], head.vertices[:, 1]
    inside = np.zeros(len(x), bool)
    for (ax, ay, _), (bx, by, _) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        crosses = (ay > y) != (by > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    front = head.vertices[:, 2] > outline[:, 2].min() - 4
    return np.asarray(inside & front & _skin(head))


def _hair(head: Head) -> NDArray[np.bool_]:
    """(n,) above a hairline that is highest in the middle, and behind the ears down to the neck."""
    x, y, z = head.vertices.T
    tragion, top = head.vertices[head.landmarks["t_l"]], head.vertices[head.landmarks["tr"]]
    front = y > top[1] + 4 - 0.006 * x**2
    behind = (z < tragion[2] - 22) & (y > tragion[1] - 55)
    above_ear = (z < tragion[2] + 6) & (y > tragion[1] + 32)
    return np.asarray(_skin(head) & (front | behind | above_ear))


def _brows(head: Head) -> NDArray[np.bool_]:
    """(n,) within `BROW_MM` of the brows' upper edges, and below them."""
    nearest = np.full(len(head.vertices), np.inf)
    for brow in BROWS:
        points = network_points(head, brow)
        for a, b in pairwise(points):
            along = np.clip((head.vertices - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            away = np.linalg.norm(head.vertices - a - along[:, None] * (b - a), axis=1)
            nearest = np.minimum(nearest, away)
    return np.asarray((nearest < BROW_MM) & _skin(head))


def _angle_from_axis(ball: Array) -> Array:
    """(k,) degrees from the forward axis through the middle of an eyeball's vertices."""
    side = ball[:, :2].mean(0)
    radius = float(np.ptp(ball[:, 0])) / 2
    away = np.linalg.norm(ball[:, :2] - side, axis=1)
    return np.asarray(np.degrees(np.arcsin(np.clip(away / radius, 0, 1))))
