"""The head of the default profile: with a sheet beside the face, for what its outline borders on.

The outline of a real face is nowhere exactly that of the fitted head.  The sheet carries on where
the skin ends: it hangs behind the cheeks, moves with them, and wears texture as they do.  So ears,
hair and whatever else is seen beside the face are learned with the face.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from shared_model.aperture_sheets import head_with_aperture_sheets
from shared_model.mesh import PARTS, Head

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# From where to where it reaches around the face, degrees upwards from straight aside.
DIRECTIONS_DEG = np.arange(50.0, -90.1, -5.0)
# Its rings, in radii of the face's outline, and how much of the still behind each hides.
# Between the first two it wears the colour of the strip's edge: below a raised chin one sees
# under the face.
RINGS = (0.75, 0.94, 1.06, 1.4)
OPACITIES = (1.0, 1.0, 1.0, 0.0)
# Where they lie across the strip of the atlas; most of it shows what is next to the face.
RING_COLUMNS = (1.0, 1.0, 0.4, 0.0)
# But for the first they are nearer to the outline towards the chin: directions, parts of the way.
NARROWING = ((-90.0, -20.0), (0.4, 1.0))
# Vertices this near to a direction make the outline there.
OUTLINE_WINDOW_DEG = 6.0
# Its share of the atlas: a strip along either side, this wide, between these rows.
STRIP_WIDTH = 0.07
STRIP_GAP = 0.006
STRIP_ROWS = (0.006, 0.885)
# Its halves pass into each other under the chin: directions, parts of the other half.
SEAM_BLEND = ((-90.0, -65.0), (0.5, 0.0))
# It hangs this far behind the plane in which the skin ends, mm.
BEHIND_MM = 1.0


@cache
def head_with_surround() -> Head:
    """The head with all sheets; the vertices of the one beside the face come last."""
    head = head_with_aperture_sheets()
    kept, holders = np.arange(len(head.vertices)), surround_anchors(head)
    carried = np.concatenate([kept, holders])
    count = len(holders)
    return Head(
        vertices=np.concatenate([head.vertices, _vertices(head)]),
        # First, for what fades out over it to be drawn later.
        triangles=np.concatenate([len(kept) + _triangles(), head.triangles]).astype(np.int32),
        texture_coordinates=np.concatenate(
            [_texture_coordinates_between_strips(head), _texture_coordinates()]
        ),
        parts=np.append(head.parts, np.full(count, PARTS.index("surround"), np.uint8)),
        opacity=np.append(head.opacity, np.tile(np.outer(OPACITIES, _opacity_along()).ravel(), 2)),
        landmarks=head.landmarks,
        network_triangles=_renumbered_landmarks(head, len(_triangles())),
        network_weights=head.network_weights,
        eau_up=head.eau_up[:, carried],
        eau_down=head.eau_down[:, carried],
        aau=head.aau[:, carried],
    )


def blend_surround_seam(atlas: NDArray[np.float32]) -> NDArray[np.float32]:
    """An atlas, or a mode of one, whose strips are alike where the sheet's halves meet.

    Each half has seen the neck from its own side only: there would be a seam.
    atlas: (n, n, channels) float32.
    """
    size = len(atlas)
    rows = np.linspace(*STRIP_ROWS, len(DIRECTIONS_DEG))
    directions_deg = np.interp((np.arange(size) + 0.5) / size, rows, DIRECTIONS_DEG)
    columns = np.minimum(np.arange(size), np.arange(size)[::-1]) < int(STRIP_WIDTH * size)
    share = np.outer(np.interp(directions_deg, *SEAM_BLEND), columns).astype(np.float32)
    return atlas + share[..., None] * (atlas[:, ::-1] - atlas)


def surround_anchors(head: Head) -> Indices:
    """(r,) the vertex of the head that each vertex of the sheet moves with.

    The sheet's vertices: the subject's left half, then the right; ring by ring from the face
    outwards; each from the temple down to the chin.
    """
    return np.concatenate([np.tile(_outline(head, side)[1], len(RINGS)) for side in (1, -1)])


def _outline(head: Head, side: int) -> tuple[Array, Indices]:
    """Radius, mm, of the face's outline in each direction, seen from the front; whose it is."""
    skin, centre, _ = _skin(head)
    away = head.vertices[skin, :2] - centre
    along = _directions(side) @ away.T
    beside = along > np.cos(np.deg2rad(OUTLINE_WINDOW_DEG)) * np.linalg.norm(away, axis=1)
    reach = np.where(beside, along, -np.inf)
    return np.asarray(reach.max(1)), skin[reach.argmax(1)]


def _skin(head: Head) -> tuple[Indices, Array, float]:
    """The face's vertices, their middle seen from the front, and where they end behind, mm."""
    skin = np.flatnonzero((head.opacity > 0) & (head.parts == PARTS.index("skin")))
    low, high = head.vertices[skin].min(0), head.vertices[skin].max(0)
    return skin, (low + high)[:2] / 2, float(low[2])


def _directions(side: int) -> Array:
    angles = np.deg2rad(DIRECTIONS_DEG)
    return np.stack([side * np.cos(angles), np.sin(angles)], 1)


def _vertices(head: Head) -> Array:
    _, centre, behind_mm = _skin(head)
    flat = [
        centre + (radii * _outline(head, side)[0])[:, None] * _directions(side)
        for side in (1, -1)
        for radii in _radii()
    ]
    places = np.concatenate(flat)
    return np.column_stack([places, np.full(len(places), behind_mm - BEHIND_MM)])


def _radii() -> Array:
    """(rings, directions) in those of the outline; the neck does not move as the jaw above it."""
    radii = 1 + np.outer(np.array(RINGS) - 1, np.interp(DIRECTIONS_DEG, *NARROWING))
    radii[0] = RINGS[0]
    return radii


def _opacity_along() -> Array:
    """0 where the sheet begins at the temple, and soon 1."""
    return np.minimum(np.arange(len(DIRECTIONS_DEG)) / 2, 1)


def _triangles() -> Indices:
    """Counter-clockwise seen from the front."""
    count = len(DIRECTIONS_DEG)
    inner = np.concatenate([ring * count + np.arange(count - 1) for ring in range(len(RINGS) - 1)])
    outer = inner + count
    right = np.concatenate(
        [np.stack([inner, outer, outer + 1], 1), np.stack([inner, outer + 1, inner + 1], 1)]
    )
    return np.concatenate([right[:, ::-1], len(RINGS) * count + right])


def _texture_coordinates() -> Array:
    v = np.linspace(*STRIP_ROWS, len(DIRECTIONS_DEG))
    strip = [
        np.stack([np.full_like(v, share * (STRIP_WIDTH - STRIP_GAP)), v], 1)
        for share in RING_COLUMNS
    ]
    right = np.concatenate(strip)
    return np.concatenate([[1, 0] + right * [-1, 1], right])


def _texture_coordinates_between_strips(head: Head) -> Array:
    """The head's own chart between the strips."""
    middle = STRIP_WIDTH + (1 - 2 * STRIP_WIDTH) * head.texture_coordinates[:, 0]
    return np.stack([middle, head.texture_coordinates[:, 1]], 1)


def _renumbered_landmarks(head: Head, before: int) -> NDArray[np.int32]:
    """The network's points keep their triangles, `before` of which now come first."""
    found = head.network_triangles
    return np.where(found < 0, found, found + before).astype(np.int32)
