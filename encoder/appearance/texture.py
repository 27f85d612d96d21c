"""The texture of one frame (thesis 2.4.2): sampled where visible, completed where hidden."""

import cv2
import numpy as np

from encoder.appearance.texel_visibility import visible_texels
from runtime.image_ops import sample_bicubic
from shared_model import geometry
from shared_model.appearance import Atlas, pull_push_fill
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.geometry import Camera
from shared_model.mesh import PARTS, Head, inside_mouth
from shared_model.parameters import Pose

# Colours of the inside of the mouth where no frame shows it, BGR, under the reference illuminant.
DEFAULT_COLOURS = {
    "teeth_upper": (150, 165, 170),
    "teeth_lower": (130, 145, 150),
    "tongue": (75, 70, 135),
    "mouth": (30, 25, 50),
}
# The colour of the white of the eyes under the reference illuminant, BGR, and the percentile of the
# eyes' texels that is taken for it.
REFERENCE_WHITE = (130, 140, 165)
WHITE_PERCENTILE = 90
# Range of illuminants, relative to the reference.
MIN_ILLUMINANT, MAX_ILLUMINANT = 0.4, 1.2
# Reach of a texel's neighbourhood in each direction, texels.
NEIGHBOURHOOD = 2
# A texel inside the mouth is sampled only if this share of its neighbourhood is visible inside the
# mouth, too: a narrow slit between the lips shows as much of the lips.
MIN_COVERAGE = 0.7
# A texel is mirrored from the other half of the face only if at most this share of its
# neighbourhood is known.  Narrow folds are filled from their neighbourhood instead, because the
# other half of the face may be lit differently.
MAX_MIRROR_COVERAGE = 0.1
# Texels per pixel of an atlas that is fitted to the picture: sampling and drawing interpolate
# twice, and equal densities would blur.
TEXELS_PER_PIXEL = 1.8
# A frame with no more pixels per texel than this is sampled without a prefilter.
MAX_PIXELS_PER_TEXEL = 1.2


def extract_texture(
    head: Head, atlas: Atlas, camera: Camera, pose: Pose, vertices: Array, frame: Picture
) -> Picture:
    """The whole atlas, (size, size, 3) uint8 BGR, from one frame.

    Hidden texels are taken from the other half of the face if that is visible (Fig. 4.5), else
    filled from their neighbourhood; the inside of a closed mouth gets default colours.
    vertices: (n, 3) mm, head frame.  frame: (h, w, 3) uint8 BGR.
    """
    points_px = geometry.pixel_from_head(camera, pose, atlas.points(vertices))
    frame, points_px = _prefiltered(frame, points_px, atlas)
    at = atlas.rows, atlas.columns
    inside = inside_mouth(head)[atlas.corners[:, 0]]
    visible = visible_texels(atlas, pose, vertices)
    visible &= head.opacity[atlas.corners].min(1) > 0
    visible &= ~inside | (_neighbourhood_coverage(atlas, visible & inside) >= MIN_COVERAGE)
    image = np.zeros((atlas.size, atlas.size, 3), dtype=np.float32)
    known = np.zeros((atlas.size, atlas.size), dtype=bool)
    image[atlas.rows[visible], atlas.columns[visible]] = sample_bicubic(frame, points_px[visible])
    known[at] = visible
    _mirror(image, known, atlas, ~inside)
    eyes = visible & np.isin(
        head.parts[atlas.corners[:, 0]], [PARTS.index("eye_left"), PARTS.index("eye_right")]
    )
    defaults = _illuminant(image[at][eyes]) * default_colours(head, atlas)
    unseen = np.isfinite(defaults[:, 0]) & ~known[at]
    image[atlas.rows[unseen], atlas.columns[unseen]] = defaults[unseen]
    known[atlas.rows[unseen], atlas.columns[unseen]] = True
    return np.clip(np.rint(pull_push_fill(image, known)), 0, 255).astype(np.uint8)


def _mirror(image: Single, known: Mask, atlas: Atlas, is_skin: Mask) -> None:
    """Copy unknown texels of the skin from the other half of the face, in place.

    image: (size, size, 3).  known: (size, size).  is_skin: (k,) of the atlas' texels.
    """
    at = atlas.rows, atlas.columns
    mirrored = np.zeros_like(known)
    few_known = _neighbourhood_coverage(atlas, known[at]) <= MAX_MIRROR_COVERAGE
    mirrored[at] = known[:, ::-1][at] & is_skin & ~known[at] & few_known
    image[mirrored] = image[:, ::-1][mirrored]
    known |= mirrored


def _neighbourhood_coverage(atlas: Atlas, chosen: Mask) -> Single:
    """(k,) the share of chosen texels (k,) among the neighbours of each texel."""
    grid = np.zeros((atlas.size, atlas.size), np.float32)
    grid[atlas.rows, atlas.columns] = chosen
    side = 2 * NEIGHBOURHOOD + 1
    coverage = cv2.boxFilter(grid, -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(coverage[atlas.rows, atlas.columns], np.float32)


def _illuminant(eyes: Single) -> Single:
    """(3,) BGR of the light, relative to the reference, from the colours (n, 3) of the eyes.

    Skin would tell less, because its own colour varies more than that of the eyes.
    """
    if not len(eyes):
        return np.ones(3, np.float32)
    white = np.percentile(eyes, WHITE_PERCENTILE, axis=0) / REFERENCE_WHITE
    return np.asarray(np.clip(white, MIN_ILLUMINANT, MAX_ILLUMINANT), np.float32)


def default_colours(head: Head, atlas: Atlas) -> Single:
    """(k, 3) BGR: `DEFAULT_COLOURS` of texels inside the mouth, nan elsewhere."""
    part = head.parts[atlas.corners[:, 0]]
    colours = np.full((len(part), 3), np.nan, dtype=np.float32)
    for name, colour in DEFAULT_COLOURS.items():
        colours[part == PARTS.index(name)] = colour
    return colours


def pixels_per_texel(atlas: Atlas, camera: Camera, pose: Pose, vertices: Array) -> float:
    """Pixels of the picture per texel where the face is seen at high resolution.

    vertices: (n, 3) mm, head frame.
    """
    return _texel_spacing_px(geometry.pixel_from_head(camera, pose, atlas.points(vertices)), atlas)


def atlas_size_for(atlas: Atlas, camera: Camera, pose: Pose, vertices: Array, largest: int) -> int:
    """Texels a side that give `TEXELS_PER_PIXEL`: a multiple of 16, at most `largest`.

    atlas: an atlas of the same head, of any size.  vertices: (n, 3) mm, head frame.
    """
    size = TEXELS_PER_PIXEL * atlas.size * pixels_per_texel(atlas, camera, pose, vertices)
    return int(np.clip(16 * np.ceil(size / 16), 48, largest))


def _texel_spacing_px(points_px: Array, atlas: Atlas) -> float:
    """Pixels between neighbouring texels of a row: a percentile above the median.

    points_px: (k, 2) of the texels.
    """
    left = np.flatnonzero((np.diff(atlas.columns) == 1) & (np.diff(atlas.rows) == 0))
    steps = np.linalg.norm(points_px[left + 1] - points_px[left], axis=1)
    return float(np.percentile(steps, 60))


def _prefiltered(frame: Picture, points_px: Array, atlas: Atlas) -> tuple[Picture, Array]:
    """The frame scaled down to one pixel per texel, against aliasing, and the points in it."""
    spacing_px = _texel_spacing_px(points_px, atlas)
    if spacing_px <= MAX_PIXELS_PER_TEXEL:
        return frame, points_px
    scale = 1 / spacing_px
    small = cv2.resize(frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    ratio = np.array([small.shape[1] / frame.shape[1], small.shape[0] / frame.shape[0]])
    return np.asarray(small, dtype=np.uint8), (points_px + 0.5) * ratio - 0.5
