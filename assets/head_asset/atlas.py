"""Texture coordinates: one chart for all that the front shows, islands below it for the rest."""

import numpy as np

from assets.head_asset.chart import HalfChart, flat_shapes, flatten
from assets.head_asset.mesh_parts import (
    EYE_LEFT,
    MOUTH,
    SKIN,
    TEETH_LOWER,
    TEETH_UPPER,
    TONGUE,
    Mesh,
)
from assets.head_asset.regions import FEATHER_MM, beyond_outline, feature_closeness, smoothstep
from shared_model.arrays import Array, Integers, Mask

# The chart takes the top of the atlas; the islands share the strip below.
CHART_HEIGHT = 0.89
MARGIN = 0.008
# The chart's eye openings are this much higher than the lids leave open: room for what lids hide.
EYE_ROOM = 1.35
# Half the height, mm, at which the closed mouth is opened in the chart, to part the lips' texels.
SLIT_MM = 0.8
# How much the distortion of the feathered border counts.
BORDER_WEIGHT = 0.1
ISLANDS = (TEETH_UPPER, TEETH_LOWER, TONGUE, MOUTH)


def texture_coordinates(mesh: Mesh, chart: Integers) -> Array:
    """(n, 2) in [0, 1], u to the subject's left, v down.  chart: (m, 3) its triangles."""
    eye_loop = border_loop(chart, near=mesh.vertices[mesh.parts == EYE_LEFT].mean(0), mesh=mesh)
    half = _half_chart(mesh, chart, eye_loop)
    width, height = 0.5 - MARGIN, CHART_HEIGHT - 2 * MARGIN
    flat = flatten(half, width, height)
    uv = np.zeros((len(mesh.vertices), 2))
    left = np.unique(chart[mesh.vertices[chart][:, :, 0].mean(1) > 0])
    uv[left] = np.stack([0.5 + flat[left, 0], MARGIN + height - flat[left, 1]], 1)
    # Skin that never shows sits on one point of the border and covers no texel.
    top = half.seam[0]
    uv[np.setdiff1d(np.flatnonzero(mesh.parts == SKIN), chart)] = uv[top]
    _place_eye(mesh, eye_loop, uv)
    right = mesh.vertices[:, 0] < -1e-6
    uv[right] = uv[mesh.mirror[right]] * [-1, 1] + [1, 0]
    for slot, part in enumerate(ISLANDS):
        _place_island(mesh, part, slot, uv)
    return uv


def in_chart(mesh: Mesh) -> Mask:
    """(m,) which triangles of skin may ever be shown: one disc with holes for eyes and mouth."""
    near = beyond_outline(mesh.vertices) < FEATHER_MM
    skin = mesh.parts[mesh.triangles[:, 0]] == SKIN
    shown = skin & near[mesh.triangles].any(1) & (mesh.masks["ears"] < 0.5)[mesh.triangles].all(1)
    whole = _directed_edges(mesh.triangles[skin])
    while True:
        left = np.flatnonzero(shown)
        ragged = _ragged(mesh.triangles[left], whole)
        if not ragged.any():
            return np.asarray(shown)
        shown[left[ragged]] = False


def border_loop(triangles: Integers, near: Array, mesh: Mesh) -> Integers:
    """The open border that passes nearest to a point, in order."""
    follow = _border_edges(triangles)
    loops = []
    while follow:
        first = min(follow)
        loop = [first]
        while (onward := follow.pop(loop[-1])) != first:
            loop.append(onward)
        loops.append(loop)
    away = [float(np.linalg.norm(mesh.vertices[loop].mean(0) - near)) for loop in loops]
    return np.array(loops[int(np.argmin(away))])


def _directed_edges(triangles: Integers) -> set[tuple[int, int]]:
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return {(int(a), int(b)) for a, b in edges}


def _border_edges(triangles: Integers) -> dict[int, int]:
    present = _directed_edges(triangles)
    return {a: b for a, b in sorted(present) if (b, a) not in present}


def _ragged(triangles: Integers, whole: set[tuple[int, int]]) -> Mask:
    """Triangles that hang on by one edge, or lie on the border where the disc pinches.

    whole: directed edges of all skin; where that itself ends (lids, lips) the chart may be ragged.
    """
    present = _directed_edges(triangles)
    cut = {(a, b) for a, b in present if (b, a) not in present and (b, a) in whole}
    starts = [a for a, _ in cut]
    pinched = {a for a in starts if starts.count(a) > 1}
    border = [[(int(t[i]), int(t[i - 2])) in cut for i in range(3)] for t in triangles]
    pinches = [any(int(v) in pinched for v in t) for t in triangles]
    count = np.array(border).sum(1)
    return np.asarray((count > 1) | ((count > 0) & np.array(pinches)))


def density(mesh: Mesh, triangles: Integers) -> Array:
    """(m,) linear texel density wanted, 1 on cheeks and forehead."""
    middle = mesh.vertices[triangles].mean(1)
    value = 1 + 1.2 * feature_closeness(middle)
    value *= 1 - 0.7 * smoothstep(beyond_outline(middle), 0, 0.7 * FEATHER_MM)
    corners = mesh.vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    backward = normal[:, 2] < -0.2 * np.linalg.norm(normal, axis=1)
    # Nostrils and the lids' inner rims are hardly ever seen; the lips' inner sides are, in speech.
    lips = (mesh.masks["lips"][triangles] > 0.5).any(1)
    inside = backward & (beyond_outline(middle) < 5)
    return np.asarray(np.where(inside, np.where(lips, 0.6, 0.35), 1.0) * value)


def _half_chart(mesh: Mesh, chart: Integers, eye_loop: Integers) -> HalfChart:
    left = chart[mesh.vertices[chart][:, :, 0].mean(1) > 0]
    shapes = flat_shapes(mesh.vertices[left], density(mesh, left))
    eye, eye_shapes = _eye_filler(mesh, eye_loop)
    slit, slit_shapes = _mouth_filler(mesh, chart)
    triangles = np.concatenate([left, eye, slit])
    # What fades out may be as distorted as the face needs it to be.
    out = beyond_outline(mesh.vertices[left].mean(1))
    weights = np.concatenate(
        [
            1 - (1 - BORDER_WEIGHT) * smoothstep(out, 0, 0.5 * FEATHER_MM),
            np.ones(len(eye) + len(slit)),
        ]
    )
    follow = _border_edges(triangles)
    on_seam = np.abs(mesh.vertices[:, 0]) < 1e-6
    loop = [min(follow, key=lambda v: (not on_seam[v], -mesh.vertices[v, 1]))]
    while (onward := follow[loop[-1]]) != loop[0]:
        loop.append(onward)
    # Counter-clockwise with the seam on the left: down the seam, then up around the cheek.
    seam = [v for v in loop if on_seam[v]]
    rim = [v for v in loop if not on_seam[v]]
    return HalfChart(
        triangles,
        np.concatenate([shapes, eye_shapes, slit_shapes]),
        weights,
        np.array(seam),
        np.array(rim),
    )


def _eye_filler(mesh: Mesh, loop: Integers) -> tuple[Integers, Array]:
    """A fan over the left eye's opening about an extra vertex, n, and its wanted shapes."""
    room = _roomy(mesh.vertices[loop][:, :2])
    fan = np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(mesh.vertices))], 1)
    middle = np.tile(room.mean(0), (len(loop), 1))
    corners = np.stack([np.roll(room, -1, 0), room, middle], 1)
    return fan, flat_shapes(
        np.concatenate([corners, np.zeros((len(loop), 3, 1))], 2), np.full(len(loop), 2.2)
    )


def _mouth_filler(mesh: Mesh, chart: Integers) -> tuple[Integers, Array]:
    """A strip of triangles between the lips of the left half, and its wanted shapes."""
    bag = mesh.vertices[mesh.parts == MOUTH]
    loop = border_loop(chart, near=bag[bag[:, 2] > 75].mean(0), mesh=mesh)
    x = mesh.vertices[loop, 0]
    corner = int(np.argmax(x))
    loop = np.roll(loop, -corner)
    # From the left corner along one lip to the middle, and back from the corner along the other.
    middle = [int(i) for i in np.flatnonzero(np.abs(mesh.vertices[loop, 0]) < 1e-6)]
    one, other = loop[: middle[0] + 1], np.concatenate([loop[:1], loop[middle[1] :][::-1]])
    upper, lower = (
        (one, other) if mesh.vertices[one[-1], 1] > mesh.vertices[other[-1], 1] else (other, one)
    )
    place = {
        int(v): np.array([mesh.vertices[v, 0], sign * SLIT_MM, 0.0])
        for sign, side in ((1, upper), (-1, lower))
        for v in side
    }
    place[int(loop[0])][1] = 0.0
    strip = []
    i = j = 0
    while i < len(upper) - 1 or j < len(lower) - 1:
        ahead_upper = mesh.vertices[upper[i + 1], 0] if i < len(upper) - 1 else -np.inf
        ahead_lower = mesh.vertices[lower[j + 1], 0] if j < len(lower) - 1 else -np.inf
        if ahead_upper >= ahead_lower:
            strip.append((upper[i], upper[i + 1], lower[j]))
            i += 1
        else:
            strip.append((upper[i], lower[j + 1], lower[j]))
            j += 1
    # The first triangle at the corner may name it twice.
    triangles = np.array([t for t in strip if len(set(t)) == 3])
    corners = np.array([[place[int(v)] for v in t] for t in triangles])
    return triangles, flat_shapes(corners, np.full(len(triangles), 2.0))


def _roomy(outline: Array) -> Array:
    """An eye's outline (k, 2), mm, made higher by `EYE_ROOM`."""
    centre = outline.mean(0)
    return np.asarray(centre + (outline - centre) * [1.0, EYE_ROOM])


def _place_eye(mesh: Mesh, loop: Integers, uv: Array) -> None:
    """Put the left eyeball into its opening as seen from the front; what is too wide on the rim."""
    outline = _roomy(mesh.vertices[loop][:, :2])
    ball = mesh.vertices[mesh.parts == EYE_LEFT][:, :2]
    # Rays from the eye's axis: what is hidden collapses along its meridian and covers no texel.
    centre = (ball.min(0) + ball.max(0)) / 2
    for v in np.flatnonzero(mesh.parts == EYE_LEFT):
        place = _pulled_inside(mesh.vertices[v, :2], outline, centre)
        uv[v] = mean_value_weights(place, outline) @ uv[loop]


def _pulled_inside(place: Array, outline: Array, centre: Array) -> Array:
    """The point itself, or where its ray from the centre leaves the outline (a hair inside)."""
    ray = place - centre
    reach = np.inf
    for a, b in zip(outline, np.roll(outline, -1, 0), strict=True):
        across = b - a
        det = ray[0] * across[1] - ray[1] * across[0]
        if abs(det) < 1e-12:
            continue
        off = a - centre
        s = (off[0] * across[1] - off[1] * across[0]) / det
        t = (off[0] * ray[1] - off[1] * ray[0]) / det
        if s > 0 and -1e-9 <= t <= 1 + 1e-9:
            reach = min(reach, s)
    return np.asarray(centre + ray * min(1.0, 0.97 * reach))


def mean_value_weights(place: Array, outline: Array) -> Array:
    """(k,) Floater's mean value coordinates of a point strictly inside a polygon (k, 2)."""
    spoke = outline - place
    length = np.linalg.norm(spoke, axis=1)
    onward = np.roll(spoke, -1, 0)
    cross = spoke[:, 0] * onward[:, 1] - spoke[:, 1] * onward[:, 0]
    half = np.arctan2(cross, (spoke * onward).sum(1)) / 2
    weight = (np.tan(half) + np.tan(np.roll(half, 1))) / length
    return np.asarray(weight / weight.sum())


def drawing_order(mesh: Mesh) -> Integers:
    """(m,) the triangles so that of two that share texels the one more often seen comes last."""
    corners = mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    part = mesh.parts[mesh.triangles[:, 0]]
    # The fronts of teeth and eyeballs, the tongue's upper side; the mouth bag's floor.
    seen = np.select(
        [part == SKIN, np.isin(part, (TONGUE, MOUTH))], [0.0, normal[:, 1]], normal[:, 2]
    )
    return np.asarray(np.lexsort((seen, part)))


def _place_island(mesh: Mesh, part: int, slot: int, uv: Array) -> None:
    index = np.flatnonzero(mesh.parts == part)
    points = mesh.vertices[index]
    # Teeth as seen from the front, tongue and mouth bag as seen from above.
    seen = points[:, :2] * [1, -1] if part in (TEETH_UPPER, TEETH_LOWER) else points[:, [0, 2]]
    unit = (seen - seen.min(0)) / np.ptp(seen, axis=0)
    size = np.array([1 / len(ISLANDS) - 2 * MARGIN, 1 - CHART_HEIGHT - 2 * MARGIN])
    uv[index] = np.array([slot / len(ISLANDS) + MARGIN, CHART_HEIGHT + MARGIN]) + unit * size
