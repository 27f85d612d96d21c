"""The head of the default profile: with a sheet around the face, the surround.

The outline of the fitted head deviates from that of the real face.  The surround extends the skin
beyond its edge: it lies behind the cheeks, moves with them, and has texture and modes as they have.
So the appearance model includes ears, hair and anything else next to the face.
"""

from functools import cache

import numpy as np

from shared_model.aperture_sheets import head_with_aperture_sheets
from shared_model.arrays import Array, Indices, Single, VertexIndices
from shared_model.mesh import PARTS, Head

# Directions from the middle of the face, degrees upwards from horizontal.
DIRECTIONS_DEG = np.arange(50.0, -90.1, -5.0)
# Radii of its rings relative to the outline of the face, and their opacities over the background.
# The first two have the same texture coordinates, the strip's edge: the region between them is
# visible below a raised chin.
RINGS = (0.75, 0.94, 1.06, 1.4)
OPACITIES = (1.0, 1.0, 1.0, 0.0)
# Columns of the rings in the strip of the atlas, 0 at its outer edge to 1.
RING_COLUMNS = (1.0, 1.0, 0.4, 0.0)
# Factor of the rings' distance from the outline, by direction; the first ring is unaffected.
NARROWING = ((-90.0, -20.0), (0.4, 1.0))
# Vertices within this angle of a direction determine the outline there.
OUTLINE_WINDOW_DEG = 6.0
# Its part of the atlas: a strip along either side, its width, gap to the face and rows, 0..1.
STRIP_WIDTH = 0.07
STRIP_GAP = 0.006
STRIP_ROWS = (0.006, 0.885)
# Weight of the other half in the texture of each half under the chin, by direction.
SEAM_BLEND = ((-90.0, -65.0), (0.5, 0.0))
# Distance behind the plane in which the skin ends, mm.
BEHIND_MM = 1.0


@cache
def head_with_surround() -> Head:
    """The head with all sheets; the vertices of the surround are the last ones."""
    head = head_with_aperture_sheets()
    anchors = surround_anchors(head)
    sources = np.concatenate([np.arange(len(head.vertices)), anchors])
    first, count = len(head.vertices), len(anchors)
    return Head(
        vertices=np.concatenate([head.vertices, _vertices(head)]),
        # First, so that the transparent edge of the skin is blended over it.
        triangles=np.concatenate([first + _triangles(), head.triangles]).astype(np.int32),
        texture_coordinates=np.concatenate(
            [_texture_coordinates_between_strips(head), _texture_coordinates()]
        ),
        parts=np.append(head.parts, np.full(count, PARTS.index("surround"), np.uint8)),
        opacity=np.append(head.opacity, np.tile(np.outer(OPACITIES, _opacity_along()).ravel(), 2)),
        landmarks=head.landmarks,
        network_triangles=_renumbered_landmarks(head, len(_triangles())),
        network_weights=head.network_weights,
        eau_up=head.eau_up[:, sources],
        eau_down=head.eau_down[:, sources],
        aau=head.aau[:, sources],
    )


def blend_surround_seam(atlas: Single) -> Single:
    """An atlas, or a mode of one, whose strips agree where the halves of the surround meet.

    The texture of each half is sampled from its own side of the neck, which would leave a seam.
    atlas: (n, n, channels) float32.
    """
    size = len(atlas)
    rows = np.linspace(*STRIP_ROWS, len(DIRECTIONS_DEG))
    directions_deg = np.interp((np.arange(size) + 0.5) / size, rows, DIRECTIONS_DEG)
    columns = np.minimum(np.arange(size), np.arange(size)[::-1]) < int(STRIP_WIDTH * size)
    weight = np.outer(np.interp(directions_deg, *SEAM_BLEND), columns).astype(np.float32)
    return atlas + weight[..., None] * (atlas[:, ::-1] - atlas)


def surround_anchors(head: Head) -> Indices:
    """(r,) the vertex of the head with which each vertex of the surround moves.

    Order of the vertices: the subject's left half, then the right; in each the rings from the face
    outwards; each ring from the temple down to the chin.
    """
    return np.concatenate([np.tile(_outline(head, side)[1], len(RINGS)) for side in (1, -1)])


def _outline(head: Head, side: int) -> tuple[Array, Indices]:
    """Radius, mm, of the face's outline in each direction from the front, and its vertices."""
    skin, centre, _ = _skin(head)
    away = head.vertices[skin, :2] - centre
    along = _directions(side) @ away.T
    in_window = along > np.cos(np.deg2rad(OUTLINE_WINDOW_DEG)) * np.linalg.norm(away, axis=1)
    reach = np.where(in_window, along, -np.inf)
    return np.asarray(reach.max(1)), skin[reach.argmax(1)]


def _skin(head: Head) -> tuple[Indices, Array, float]:
    """The face's vertices, their middle in x and y, and their lowest z, mm."""
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
    """(rings, directions) relative to the outline; narrow at the chin, over the still neck."""
    radii = 1 + np.outer(np.array(RINGS) - 1, np.interp(DIRECTIONS_DEG, *NARROWING))
    radii[0] = RINGS[0]
    return radii


def _opacity_along() -> Array:
    """(directions,) 0 at the temple, where the surround begins, rising to 1."""
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
    """The head's texture coordinates, squeezed between the strips."""
    middle = STRIP_WIDTH + (1 - 2 * STRIP_WIDTH) * head.texture_coordinates[:, 0]
    return np.stack([middle, head.texture_coordinates[:, 1]], 1)


def _renumbered_landmarks(head: Head, before: int) -> VertexIndices:
    """`network_triangles` after the insertion of `before` triangles in front."""
    found = head.network_triangles
    return np.where(found < 0, found, found + before).astype(np.int32)
