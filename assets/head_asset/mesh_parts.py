"""The full head as a symmetric triangle mesh with parts, a mouth bag and new eyeballs."""

from dataclasses import dataclass

import numpy as np

from assets.head_asset.makehuman import Source, mirror_index
from shared_model.arrays import Array, Integers, Mask, Picture

SKIN, EYE_LEFT, EYE_RIGHT, TEETH_UPPER, TEETH_LOWER, TONGUE, MOUTH = range(7)
# Angles from the eye's axis of the rings of an eyeball: pupil, iris, then the white; degrees.
EYE_RINGS_DEG = (8.5, 16.0, 23.2, 33.0, 44.0, 57.0, 74.0, 95.0)
EYE_SEGMENTS = 16
# MakeHuman's lips rest slightly apart: the share of its target mouthClose that just shuts them,
# by |x| mm.
LIPS_X = (0.0, 5.0, 10.0, 15.0, 18.0, 20.0, 22.0, 23.0, 28.0)
LIPS_CLOSE = (0.013, 0.022, 0.029, 0.036, 0.045, 0.065, 0.095, 0.125, 0.125)
# Where the neck ends: the quads cut by height would leave it ragged, mm.
NECK_Y_MM = -101.0
# Its tongue fills the mouth; at rest it lies lower, mm.
TONGUE_REST_MM = np.array([0.0, -4.0, -5.0])


@dataclass(frozen=True, slots=True)
class Mesh:
    """A symmetric triangle mesh, no vertex shared between parts.

    vertices: (n, 3) float64, mm.  triangles: (m, 3) int64, counter-clockwise from outside.
    parts: (n,) uint8, index into `PARTS`.  mirror: (n,) int64.
    masks, targets: see `Source`.
    """

    vertices: Array
    triangles: Integers
    parts: Picture
    mirror: Integers
    masks: dict[str, Array]
    targets: dict[str, Array]


def build_mesh(source: Source) -> Mesh:
    """Triangulate symmetrically, split the mouth bag off the skin, replace the eyeballs."""
    triangles, part = _triangulate(source)
    bag = (source.masks["inside-mouth"] > 0.5)[triangles].any(1)
    part = np.where((part == SKIN) & bag, MOUTH, part)
    kept = ~np.isin(part, (EYE_LEFT, EYE_RIGHT)) & ~_sockets(source, triangles, part == SKIN)
    vertices, faces, parts, origin = _split(source.vertices, triangles[kept], part[kept])
    for side in (EYE_LEFT, EYE_RIGHT):
        ball = source.vertices[source.quads[source.quad_part == side]].reshape(-1, 3)
        points, facets = eyeball(ball)
        faces = np.concatenate([faces, facets + len(vertices)])
        vertices = np.concatenate([vertices, points])
        parts = np.concatenate([parts, np.full(len(points), side, np.uint8)])
    mirror = part_mirror(vertices, parts)
    blank = len(vertices) - len(origin)
    masks = {k: np.concatenate([m[origin], np.zeros(blank)]) for k, m in source.masks.items()}
    targets = {
        k: np.concatenate([t[origin], np.zeros((blank, 3))]) for k, t in source.targets.items()
    }
    neck = _open_neck(vertices, faces)
    vertices[neck, 1] = NECK_Y_MM
    faces = faces[~neck[faces].all(1)]
    lips = (
        np.interp(np.abs(vertices[:, [0]]), LIPS_X, LIPS_CLOSE)
        * np.isin(parts, (SKIN, MOUTH))[:, None]
    )
    close = targets["mouthClose"]
    close = (close + close[mirror] * [-1, 1, 1]) / 2
    vertices = vertices + lips * close + (parts == TONGUE)[:, None] * TONGUE_REST_MM
    return Mesh(vertices, faces, parts, mirror, masks, targets)


def part_mirror(vertices: Array, parts: Picture) -> Integers:
    """(n,) mirror images that stay in their part (eyes change places)."""
    mirror = np.zeros(len(vertices), np.int64)
    for part in range(MOUTH + 1):
        index = np.flatnonzero(parts == part)
        if part == EYE_LEFT:
            mirror[index], mirror[parts == EYE_RIGHT] = np.flatnonzero(parts == EYE_RIGHT), index
        elif part != EYE_RIGHT:
            mirror[index] = index[mirror_index(vertices[index])]
    return mirror


def eyeball(points: Array) -> tuple[Array, Integers]:
    """The front of a sphere through `points` (k, 3), as rings about its z axis.

    The same rings for both eyes, wound so that the i-th vertex of one mirrors that of the other.
    """
    centre = (points.min(0) + points.max(0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    side = np.sign(centre[0])
    turn = 2 * np.pi * np.arange(EYE_SEGMENTS) / EYE_SEGMENTS
    circle = np.stack([side * np.cos(turn), np.sin(turn), np.zeros_like(turn)], 1)
    rings = [(centre + np.array([0, 0, radius]))[None]]
    for angle in np.radians(EYE_RINGS_DEG):
        rings.append(centre + radius * (np.sin(angle) * circle + [0, 0, np.cos(angle)]))
    here = np.arange(EYE_SEGMENTS)
    ahead = (here + 1) % EYE_SEGMENTS
    faces = [np.stack([0 * here, 1 + here, 1 + ahead], 1)]
    for ring in range(len(EYE_RINGS_DEG) - 1):
        inner, outer = 1 + ring * EYE_SEGMENTS, 1 + (ring + 1) * EYE_SEGMENTS
        faces.append(np.stack([inner + here, outer + here, outer + ahead], 1))
        faces.append(np.stack([inner + here, outer + ahead, inner + ahead], 1))
    facets = np.concatenate(faces)
    return np.concatenate(rings), facets if side > 0 else facets[:, [0, 2, 1]]


def _triangulate(source: Source) -> tuple[Integers, Integers]:
    """Split each quad of the left half along its shorter diagonal and mirror the result."""
    v = source.vertices
    left = v[source.quads][:, :, 0].mean(1) > 0
    q, part = source.quads[left], source.quad_part[left].astype(np.int64)
    straight = np.linalg.norm(v[q[:, 0]] - v[q[:, 2]], axis=1) <= np.linalg.norm(
        v[q[:, 1]] - v[q[:, 3]], axis=1
    )
    first = np.where(straight[:, None], q[:, [0, 1, 2]], q[:, [0, 1, 3]])
    second = np.where(straight[:, None], q[:, [0, 2, 3]], q[:, [1, 2, 3]])
    half = np.concatenate([first, second])
    part = np.concatenate([part, part])
    other = np.choose(part, [0, 2, 1, 3, 4, 5])
    return np.concatenate([half, source.mirror[half][:, [0, 2, 1]]]), np.concatenate([part, other])


def _sockets(source: Source, triangles: Integers, skin: Mask) -> Mask:
    """Which triangles line the eye sockets: behind the lids' inner rims, never seen."""
    doomed = np.zeros(len(source.vertices), bool)
    edges = np.concatenate(
        [triangles[skin][:, [0, 1]], triangles[skin][:, [1, 2]], triangles[skin][:, [2, 0]]]
    )
    for side in (EYE_LEFT, EYE_RIGHT):
        ball = np.unique(source.quads[source.quad_part == side])
        centre = (source.vertices[ball].min(0) + source.vertices[ball].max(0)) / 2
        radius = np.linalg.norm(source.vertices[ball] - centre, axis=1).max()
        away = np.linalg.norm(source.vertices - centre, axis=1)
        # The lids' inner rims dip into the eyeball; the sockets lie just around it.
        rim = away < radius - 0.3
        near = np.setdiff1d(np.flatnonzero(away < radius + 2), ball)
        lining = np.zeros(len(away), bool)
        lining[near[np.argmin(source.vertices[near, 2])]] = True
        while True:
            grown = edges[lining[edges].any(1)]
            grown = grown[~rim[grown]]
            if lining[grown].all():
                break
            lining[grown] = True
        doomed |= lining
    return np.asarray(skin & doomed[triangles].any(1))


def _open_neck(vertices: Array, triangles: Integers) -> Mask:
    """Which vertices lie on the open border of the neck, or below where it is to end."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    pairs, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    border = np.zeros(len(vertices), bool)
    border[pairs[count == 1]] = True
    return np.asarray((border & (vertices[:, 1] < -95)) | (vertices[:, 1] < NECK_Y_MM))


def _split(
    vertices: Array, triangles: Integers, part: Integers
) -> tuple[Array, Integers, Picture, Integers]:
    """Give every part its own vertices; also (k,) the old vertex of each new one."""
    points, faces, parts, origin = [], [], [], []
    count = 0
    for p in np.unique(part):
        ids, local = np.unique(triangles[part == p], return_inverse=True)
        points.append(vertices[ids])
        faces.append(local.reshape(-1, 3) + count)
        parts.append(np.full(len(ids), p, np.uint8))
        origin.append(ids)
        count += len(ids)
    return (
        np.concatenate(points),
        np.concatenate(faces),
        np.concatenate(parts),
        np.concatenate(origin),
    )
