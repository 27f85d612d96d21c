"""What the face wears: the shape-free texture of a frame (thesis 2.4.2); images within a budget."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.appearance.inpaint import fill
from encoder.appearance.texel_visibility import visible_texels
from shared_model import geometry
from shared_model.appearance import Atlas
from shared_model.geometry import Camera
from shared_model.mesh import PARTS, Head, inside_mouth
from shared_model.parameters import Pose

Array = NDArray[np.float64]
Texels = NDArray[np.float32]
Picture = NDArray[np.uint8]

# What has never been seen, BGR: teeth, tongue and the dark of the mouth.
UNSEEN_COLOURS = {
    "teeth_upper": (150, 165, 170),
    "teeth_lower": (130, 145, 150),
    "tongue": (75, 70, 135),
    "mouth": (30, 25, 50),
}
# In the light in which the white of the eyes, brighter than most of them, has this colour.
USUAL_WHITE = (130, 140, 165)
WHITE_PERCENTILE = 90
LEAST_LIGHT, MOST_LIGHT = 0.4, 1.2
# What is so far from a texel in each direction is around it.
AROUND = 2
# What shows through a slit between the lips is as much the lips: of what is around a texel inside
# the mouth, this share must be seen too.
SOLID = 0.7
# Narrow folds are continued from around, since the other half of the face is lit otherwise: of what
# is around a mirrored texel, at most this share is known.
FOLDED = 0.1
# Denser than pixels: what is sampled and drawn again is interpolated twice, and blurs.
TEXELS_PER_PIXEL = 1.8


def sample(frame: NDArray[Any], positions_px: NDArray[Any]) -> Texels:
    """Colours of a picture at (k, 2) pixel positions, bicubic: (k, channels) float32."""
    columns = 1024
    rows = -(-len(positions_px) // columns)
    grid = np.zeros((2, rows * columns), dtype=np.float32)
    grid[:, : len(positions_px)] = positions_px.T
    u, v = grid.reshape(2, rows, columns)
    sampled = cv2.remap(frame, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    channels = 1 if frame.ndim == 2 else frame.shape[2]
    flat = sampled.reshape(rows * columns, channels)[: len(positions_px)]
    return np.asarray(flat, dtype=np.float32)


def extract_texture(
    head: Head, atlas: Atlas, camera: Camera, pose: Pose, vertices: Array, frame: Picture
) -> Picture:
    """The whole atlas, (size, size, 3) uint8 BGR, from one frame.

    What the frame does not show is taken from the other half of the face where that is seen
    (Fig. 4.5), else from around it; the inside of a closed mouth gets a usual colour.
    """
    points_px = geometry.pixel_from_head(camera, pose, atlas.points(vertices))
    frame, points_px = _at_texel_scale(frame, points_px, atlas)
    known = np.zeros((atlas.size, atlas.size), dtype=bool)
    image = np.zeros((atlas.size, atlas.size, 3), dtype=np.float32)
    worn = head.opacity[atlas.corners].min(1) > 0
    seen = visible_texels(head, atlas, pose, vertices) & worn
    inside = inside_mouth(head)[atlas.corners[:, 0]]
    within = np.zeros_like(known)
    within[atlas.rows, atlas.columns] = seen & inside
    seen &= ~inside | (_share_around(within) >= SOLID)[atlas.rows, atlas.columns]
    image[atlas.rows[seen], atlas.columns[seen]] = sample(frame, points_px[seen])
    known[atlas.rows[seen], atlas.columns[seen]] = True
    skin = np.zeros_like(known)
    skin[atlas.rows, atlas.columns] = ~inside
    mirrored = known[:, ::-1] & skin & ~known & (_share_around(known) <= FOLDED)
    image[mirrored] = image[:, ::-1][mirrored]
    known |= mirrored
    part = head.parts[atlas.corners[:, 0]]
    eyes = seen & np.isin(part, [PARTS.index("eye_left"), PARTS.index("eye_right")])
    usual = _light(image[atlas.rows[eyes], atlas.columns[eyes]]) * unseen_colours(head, atlas)
    hidden = np.isfinite(usual[:, 0]) & ~known[atlas.rows, atlas.columns]
    image[atlas.rows[hidden], atlas.columns[hidden]] = usual[hidden]
    known[atlas.rows[hidden], atlas.columns[hidden]] = True
    return np.clip(np.rint(fill(image, known)), 0, 255).astype(np.uint8)


def _share_around(chosen: NDArray[np.bool_]) -> Texels:
    """(n, n) how much of what is around each texel of an atlas is `chosen` (n, n)."""
    side = 2 * AROUND + 1
    share = cv2.boxFilter(
        chosen.astype(np.float32), -1, (side, side), borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(share, np.float32)


def _light(eyes: Texels) -> Texels:
    """(3,) BGR of the light on eyes of these colours (n, 3), against that of `USUAL_WHITE`.

    Skin is darker or lighter by itself, and tells less of it.
    """
    if not len(eyes):
        return np.ones(3, np.float32)
    white = np.percentile(eyes, WHITE_PERCENTILE, axis=0) / USUAL_WHITE
    return np.asarray(np.clip(white, LEAST_LIGHT, MOST_LIGHT), np.float32)


def unseen_colours(head: Head, atlas: Atlas) -> Texels:
    """(k, 3) BGR of what no frame shows: a usual colour inside the mouth, nan on the skin."""
    part = head.parts[atlas.corners[:, 0]]
    colours = np.full((len(part), 3), np.nan, dtype=np.float32)
    for name, colour in UNSEEN_COLOURS.items():
        colours[part == PARTS.index(name)] = colour
    return colours


def texel_pixels(atlas: Atlas, camera: Camera, pose: Pose, vertices: Array) -> float:
    """Pixels of the picture per texel, where the face is seen best."""
    return _spacing(geometry.pixel_from_head(camera, pose, atlas.points(vertices)), atlas)


def fitting_size(atlas: Atlas, camera: Camera, pose: Pose, vertices: Array, largest: int) -> int:
    """Texels a side, a multiple of 16 and at most `largest`, at which texels are fine enough.

    atlas: any size; it tells how much of the atlas the face takes.
    """
    size = TEXELS_PER_PIXEL * atlas.size * texel_pixels(atlas, camera, pose, vertices)
    return int(np.clip(16 * np.ceil(size / 16), 48, largest))


def _spacing(points_px: Array, atlas: Atlas) -> float:
    """Pixels from one texel to the next in its row, where the face is seen best."""
    beside = np.flatnonzero((np.diff(atlas.columns) == 1) & (np.diff(atlas.rows) == 0))
    steps = np.linalg.norm(points_px[beside + 1] - points_px[beside], axis=1)
    return float(np.percentile(steps, 60))


def _at_texel_scale(frame: Picture, points_px: Array, atlas: Atlas) -> tuple[Picture, Array]:
    """Shrink a frame in which the face has more pixels than the atlas texels, against aliasing."""
    span_px = _spacing(points_px, atlas)
    if span_px <= 1.2:
        return frame, points_px
    small = cv2.resize(frame, None, fx=1 / span_px, fy=1 / span_px, interpolation=cv2.INTER_AREA)
    ratio = np.array([small.shape[1] / frame.shape[1], small.shape[0] / frame.shape[0]])
    return np.asarray(small, dtype=np.uint8), (points_px + 0.5) * ratio - 0.5
