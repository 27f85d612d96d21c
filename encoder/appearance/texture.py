"""What the face wears: the shape-free texture of a frame (thesis 2.4.2); images within a budget."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.picture_coding.picture_encoder import draft_still
from encoder.picture_coding.quantiser_search import finest_within
from encoder.runtime.jit import compiled
from protocol.pictures.picture_codec import MAX_STEP
from protocol.pictures.probability_model import STILL
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
FACING_COSINE = 0.1
DEPTH_CELL_MM = 1.5
DEPTH_TOLERANCE_MM = 2.0
CELLS_ASIDE = 192
# Denser than pixels: what is sampled and drawn again is interpolated twice, and blurs.
TEXELS_PER_PIXEL = 1.8
QUALITIES = (1, 95)
BACKGROUND_SIDES_PX = (640, 448, 320, 224)
# So many steps of the quantiser coarser a still takes about half the bytes.
STEPS_PER_HALVING = 8


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


def visible_texels(
    head: Head, atlas: Atlas, pose: Pose, vertices: Array, cell_mm: float = DEPTH_CELL_MM
) -> NDArray[np.bool_]:
    """(k,) whether the camera sees each texel: facing it, and nothing nearer before it.

    vertices: (n, 3) mm, head frame.
    cell_mm: what counts as before it; no less than texels' spacing.
    """
    seen = geometry.camera_from_head(pose, vertices)
    return _visible(seen, atlas.corners, atlas.weights, pose.translation_mm, cell_mm)


@compiled
def _visible(
    seen: Array, corners: NDArray[np.int32], weights: Array, at_mm: Array, cell_mm: float
) -> NDArray[np.bool_]:
    count = len(corners)
    nearest = np.full((2 * CELLS_ASIDE) ** 2, np.inf)
    cells = np.zeros(count, np.int32)
    depths = np.empty(count)
    # How far behind what is nearest in its cell a texel may be; none turned away is seen at all.
    slack = np.empty(count)
    aside_x, aside_y = np.floor(at_mm[0] / cell_mm), np.floor(at_mm[1] / cell_mm)
    for k in range(count):
        ax, ay, az = seen[corners[k, 0]]
        bx, by, bz = seen[corners[k, 1]]
        cx, cy, cz = seen[corners[k, 2]]
        wa, wb, wc = weights[k]
        x, y = wa * ax + wb * bx + wc * cx, wa * ay + wb * by + wc * cy
        z = wa * az + wb * bz + wc * cz
        bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        lengths = np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z))
        facing = -(nx * x + ny * y + nz * z) / max(lengths, 1e-12)
        depths[k] = z
        slack[k] = -np.inf
        if z > 1:
            column = np.floor(x / z * at_mm[2] / cell_mm) - aside_x
            row = np.floor(y / z * at_mm[2] / cell_mm) - aside_y
            # A pose gone astray may bring the head into the camera: what is far aside shares a
            # cell.
            column = min(max(column, -CELLS_ASIDE), CELLS_ASIDE - 1) + CELLS_ASIDE
            row = min(max(row, -CELLS_ASIDE), CELLS_ASIDE - 1) + CELLS_ASIDE
            cells[k] = int(column) * 2 * CELLS_ASIDE + int(row)
            nearest[cells[k]] = min(nearest[cells[k]], z)
            if facing > FACING_COSINE:
                # Depth changes by this much within a cell of a slanting surface.
                slant = cell_mm * np.sqrt(1 - min(facing * facing, 1.0)) / facing
                slack[k] = DEPTH_TOLERANCE_MM + slant
    found = np.empty(count, np.bool_)
    for k in range(count):
        found[k] = depths[k] <= nearest[cells[k]] + slack[k]
    return found


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


def fill(image: Texels, known: NDArray[np.bool_]) -> Texels:
    """Smoothly continue an image into where it is unknown: averages from ever coarser scales."""
    weight = known.astype(np.float32)
    if known.all() or min(known.shape) <= 2:
        mean = image[known].mean(0) if known.any() else np.zeros(image.shape[2], np.float32)
        return np.where(known[..., None], image, mean)
    half = (-(-image.shape[1] // 2), -(-image.shape[0] // 2))
    size = (image.shape[1], image.shape[0])
    share = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)
    total = cv2.resize(image * weight[..., None], half, interpolation=cv2.INTER_AREA)
    # OpenCV drops the axis of a single channel.
    coarse = total.reshape(*share.shape, -1) / np.maximum(share, 1e-6)[..., None]
    filled = fill(coarse.astype(np.float32), share > 1e-6)
    around = cv2.resize(filled, size, interpolation=cv2.INTER_LINEAR).reshape(image.shape)
    return np.where(known[..., None], image, around).astype(np.float32)


def compress(picture: Picture, max_bytes: int) -> bytes:
    """The best WebP file of at most `max_bytes`; at the lowest quality even if that is larger."""
    low, high = QUALITIES
    best = _webp(picture, low)
    while low < high:
        middle = (low + high + 1) // 2
        data = _webp(picture, middle)
        if len(data) <= max_bytes:
            low, best = middle, data
        else:
            high = middle - 1
    return best


def compress_background(frame: Picture, max_bytes: int) -> bytes:
    """The WebP file within `max_bytes` nearest to `frame`, scaled down as far as that helps."""
    longest = max(frame.shape[:2])
    reach = min(longest, BACKGROUND_SIDES_PX[0])
    judged = _scaled(frame, reach / longest).astype(np.float32)
    best, least = b"", np.inf
    for side in (reach, *(s for s in BACKGROUND_SIDES_PX if s < reach)):
        data = compress(_scaled(frame, side / longest), max_bytes)
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        shown = cv2.resize(decoded, judged.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        error = float(((shown - judged) ** 2).mean()) + 1e6 * (len(data) > max_bytes)
        if error < least:
            best, least = data, error
    return best


def code_background(frame: Picture, max_bytes: int) -> bytes:
    """The still of at most `max_bytes` nearest to `frame`, its longer side at most 640 pixels."""
    small = _scaled(frame, BACKGROUND_SIDES_PX[0] / max(frame.shape[:2]))
    return finest_still(small.astype(np.float32), max_bytes)[0]


def finest_still(
    colours: Texels, max_bytes: int, relief: bytes = b"", kind: int = STILL
) -> tuple[bytes, Texels]:
    """The best coding of a picture (h, w, 3) within `max_bytes`, and what it decodes to.

    At the coarsest step even if that is larger.  relief, kind: see `draft_still`.
    """
    best = finest_within(
        lambda step: draft_still(colours, step, relief, kind),
        lambda draft: draft.size_bytes,
        max_bytes,
        range(MAX_STEP + 1),
        MAX_STEP // 2,
        STEPS_PER_HALVING,
    )[1]
    return best.write(), best.colours


def _scaled(frame: Picture, ratio: float) -> Picture:
    if ratio >= 1:
        return frame
    size = (max(1, round(frame.shape[1] * ratio)), max(1, round(frame.shape[0] * ratio)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _webp(picture: Picture, quality: int) -> bytes:
    done, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])
    assert done
    return data.tobytes()
