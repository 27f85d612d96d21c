"""The head with sheets across the apertures of the mouth and the eyes.

In the default profile the appearance modes include the inside of the mouth and the eyes.  A sheet
between the rims of an aperture serves that better than the generic mouth and eyeballs, since each
of its texels has the same position between the rims in every frame.  Closed rims leave it no area.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from shared_model.arrays import Array, VertexIndices
from shared_model.mesh import PARTS, Head, generic_head, open_edges


@dataclass(frozen=True, slots=True)
class ApertureSheet:
    """A sheet: its part of the head, and its rims as points of the landmark network.

    upper, lower: equal numbers of points, from the subject's right corner to the left.
    """

    part: str
    upper: tuple[int, ...]
    lower: tuple[int, ...]


MOUTH = ApertureSheet(
    "mouth",
    (78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308),
    (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308),
)
EYES = (
    ApertureSheet(
        "eye_left",
        (362, 398, 384, 385, 386, 387, 388, 466, 263),
        (362, 382, 381, 380, 374, 373, 390, 249, 263),
    ),
    ApertureSheet(
        "eye_right",
        (33, 246, 161, 160, 159, 158, 157, 173, 133),
        (33, 7, 163, 144, 145, 153, 154, 155, 133),
    ),
)
SHEETS = (MOUTH, *EYES)
# u and v ranges of the mouth's sheet in the atlas, where the parts that it replaces had their UV
# islands.  The sheets of the eyes fill the holes between the eyelids.
MOUTH_ISLAND = ((0.06, 0.94), (0.9, 0.99))
# Distance of the sheets behind the rims, so that the edges of the rims are in front, mm.
BEHIND_MM = 1.5
# Greatest distance of the skin's corner of the mouth from the network's, mm.
CORNER_MM = 15.0
# The texture of the face extends farther into the hair than in the thesis profile.
OPACITY_GAIN = 2.5


@cache
def head_with_aperture_sheets() -> Head:
    """The generic head with the sheets; the vertices of the rims are the last ones."""
    head = generic_head()
    carry = rim_weights(head)
    count = len(head.vertices)
    outer = _skin_triangles(head)
    behind = np.outer(_depths(), [0.0, 0.0, -1.0])

    def extended(values: Array) -> Array:
        return np.concatenate([values, carry @ values], axis=-2)

    vertices = extended(head.vertices)
    vertices[count:] += behind
    sizes = [len(sheet.upper) + len(sheet.lower) for sheet in SHEETS]
    parts = np.repeat([PARTS.index(sheet.part) for sheet in SHEETS], sizes)
    mouth, eyes = _mouth_texture_coordinates(), carry[sizes[0] :] @ head.texture_coordinates
    return Head(
        vertices=vertices,
        triangles=np.concatenate([outer, count + _triangles()]).astype(np.int32),
        texture_coordinates=np.concatenate([head.texture_coordinates, mouth, eyes]),
        parts=np.append(head.parts, parts.astype(np.uint8)),
        opacity=np.append(np.minimum(OPACITY_GAIN * head.opacity, 1), np.ones(len(carry))),
        landmarks=head.landmarks,
        network_triangles=_renumbered_landmarks(head),
        network_weights=head.network_weights,
        eau_up=extended(head.eau_up),
        eau_down=extended(head.eau_down),
        aau=extended(head.aau),
    )


def rim_weights(head: Head) -> Array:
    """(r, n) weights of the head's vertices in each rim vertex.

    Order of the rim vertices: sheet by sheet, the upper rim first.  The lips part farther out than
    the network's corners of the mouth, so the mouth's rims end at the edge of the skin instead.
    """
    points = [point for sheet in SHEETS for point in (*sheet.upper, *sheet.lower)]
    weights = np.zeros((len(points), len(head.vertices)))
    ends = np.unique(open_edges(_skin_triangles(head)))
    for row, point in enumerate(points):
        corners = head.triangles[head.network_triangles[point]]
        weights[row, corners] = head.network_weights[point]
        if point in (MOUTH.upper[0], MOUTH.upper[-1]):
            corner = _mouth_corner(head, ends, weights[row] @ head.vertices)
            weights[row] = np.arange(len(head.vertices)) == corner
    return weights


def _skin_triangles(head: Head) -> VertexIndices:
    on_skin = head.parts[head.triangles[:, 0]] == PARTS.index("skin")
    found: VertexIndices = head.triangles[on_skin]
    return found


def _mouth_corner(head: Head, ends: VertexIndices, place_mm: Array) -> int:
    """The outermost vertex of `ends`, the edge of the skin, near a position (3,), mm."""
    distance_mm = np.linalg.norm(head.vertices[ends] - place_mm, axis=1)
    near = ends[distance_mm < CORNER_MM]
    return int(near[np.abs(head.vertices[near, 0]).argmax()])


def _depths() -> Array:
    """(r,) distance of each rim vertex behind its rim, mm; 0 at the corners, to leave no gap."""
    rims = [rim for sheet in SHEETS for rim in (sheet.upper, sheet.lower)]
    return np.concatenate([np.pad(np.full(len(rim) - 2, BEHIND_MM), 1) for rim in rims])


def _renumbered_landmarks(head: Head) -> VertexIndices:
    """`network_triangles` after the removal of the triangles that are not skin."""
    inside = head.parts[head.triangles[:, 0]] != PARTS.index("skin")
    number = np.cumsum(~inside) - 1
    found = np.where(inside[head.network_triangles], -1, number[head.network_triangles])
    return np.where(head.network_triangles < 0, -1, found).astype(np.int32)


def _triangles() -> VertexIndices:
    """Triangles between the rims of each sheet, counter-clockwise seen from outside."""
    strips, first = [], 0
    for sheet in SHEETS:
        count = len(sheet.upper)
        upper = first + np.arange(count - 1)
        lower = upper + count
        strips.append(np.stack([upper, lower, lower + 1], 1))
        strips.append(np.stack([upper, lower + 1, upper + 1], 1))
        first += 2 * count
    return np.concatenate(strips).astype(np.int32)


def _mouth_texture_coordinates() -> Array:
    (left, right), (top, bottom) = MOUTH_ISLAND
    u = np.linspace(left, right, len(MOUTH.upper))
    rows = [np.stack([u, np.full_like(u, v)], 1) for v in (top, bottom)]
    return np.concatenate(rows)
