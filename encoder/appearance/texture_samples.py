"""Shape-free pictures of a caller: what an appearance model is learned from (thesis eq. 2.17)."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFree, spacing
from encoder.appearance.texture import DEPTH_CELL_MM, fill, sample, visible_texels
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import Template
from encoder.fitting.landmark_fit import OUTLINE, outline_of
from encoder.runtime.parallel import on_cores
from shared_model.appearance import Atlas
from shared_model.mesh import OUTER_LIPS, PARTS, Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# What hair and neck count beside the face, and how soft the border is, in atlas sides.
OUTSIDE = 0.03
SOFT_EDGE = 0.015
# What squared errors in the mouth and on the lips of a live caller count, since lips are read.
MOUTH = 2.5
# Pixels of the frame beyond the landmarks' outline that count as the face: where a face is small
# the outline is a pixel off.
BORDER_PX = 1.0


@dataclass(frozen=True, slots=True)
class Stack:
    """Shape-free pictures of some frames.

    colours: (t, k, 3) float32 BGR, or (t, k, 1) luma.  seen: (t, k).  weight: (k,) float32.
    """

    colours: Single
    seen: NDArray[np.bool_]
    weight: Single


def face_mask(head: Head, atlas: Atlas) -> Single:
    """(k,) 1 within the face's outline, smoothly `OUTSIDE` in the hair and beyond the jaw.

    The inside of the mouth counts as face.
    """
    found = np.maximum(_soft_hull(head, atlas, OUTLINE), OUTSIDE)
    return np.where(_is_mouth(head, atlas), 1, found).astype(np.float32)


def mouth_weight(head: Head, atlas: Atlas) -> Single:
    """(k,) what texels count besides their pixels: `MOUTH` in the mouth and on the lips, else 1."""
    mouth = np.where(_is_mouth(head, atlas), 1, _soft_hull(head, atlas, OUTER_LIPS))
    return (1 + (MOUTH - 1) * mouth).astype(np.float32)


def _soft_hull(head: Head, atlas: Atlas, points: Sequence[int]) -> Single:
    """(k,) 1 within the hull of some landmarks, smoothly 0 beyond."""
    chosen = list(points)
    corners = head.triangles[head.network_triangles[chosen]]
    places = np.einsum(
        "mc,mcd->md", head.network_weights[chosen], head.texture_coordinates[corners]
    )
    mask = hull_mask(places * atlas.size - 0.5, (atlas.size, atlas.size))
    soft = cv2.GaussianBlur(mask, (0, 0), max(0.5, SOFT_EDGE * atlas.size))
    return np.asarray(np.clip(2 * soft[atlas.rows, atlas.columns], 0, 1), np.float32)


def _is_mouth(head: Head, atlas: Atlas) -> NDArray[np.bool_]:
    """(k,) which texels are of the inside of the mouth."""
    return np.asarray(head.parts[atlas.corners[:, 0]] == PARTS.index("mouth"))


def within_outline(
    shape: ShapeFree,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    points: Sequence[Array],
) -> Single:
    """(k,) share of the frames in which each texel lies within the landmarks' outline of the face,
    or no further outside than `BORDER_PX`.

    points: (468, >= 2) pixels, landmarks of each frame.
    """
    count = np.zeros(len(shape), np.float32)
    for crop, face, places in zip(crops, faces, points, strict=True):
        outline = outline_of(places)
        outward = outline - outline.mean(0)
        lengths = np.linalg.norm(outward, axis=1, keepdims=True)
        wider = outline + BORDER_PX * outward / np.maximum(lengths, 1.0)
        corners = crop.from_frame(wider.astype(np.float32))
        height, width = crop.picture.shape[:2]
        mask = hull_mask(corners, (height, width))
        count += sample(mask, crop.from_frame(shape.positions(face)))[:, 0].clip(0, 1)
    return count / np.float32(max(len(crops), 1))


def hull_mask(points: NDArray[np.floating], shape: tuple[int, int]) -> Single:
    """(h, w) 1 within the convex hull of points (n, 2), pixels, else 0."""
    mask = np.zeros(shape, np.float32)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(points).astype(np.int32)), 1.0)
    return mask


def shape_free_stack(
    head: Head,
    shape: ShapeFree,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    vertices: Sequence[Array],
    cell_mm: float = DEPTH_CELL_MM,
    workers: int | None = None,
) -> Stack:
    """Sample the texels of `shape` in every crop.

    vertices: (n, 3) of each frame, head frame.  cell_mm: see `visible_texels`.
    workers: see `on_cores`.
    """

    def look(view: tuple[Crop, FaceParameters, Array]) -> tuple[Single, NDArray[np.bool_], Single]:
        crop, face, mesh = view
        positions = shape.positions(face)
        colours = sample(crop.picture, crop.from_frame(positions))
        seen = visible_texels(head, shape.atlas, face.pose, mesh, cell_mm)
        return colours, seen, texel_areas(shape, positions) * seen

    views = on_cores(look, zip(crops, faces, vertices, strict=True), workers)
    colours, seen, areas = (np.array(parts) for parts in zip(*views, strict=True))
    return Stack(colours, seen, areas.mean(0).astype(np.float32))


def texel_areas(shape: ShapeFree, positions: Single) -> Single:
    """(k,) pixels that each texel covers in the frame."""
    ax, ay, bx, by = spacing(shape.whole(positions), shape.place)
    found = np.abs(ax * by - ay * bx)
    usual = float(np.nanmedian(found))
    return np.asarray(np.minimum(np.nan_to_num(found, nan=usual), 4 * usual), np.float32)


def mean_colours(shape: ShapeFree, stack: Stack, unseen: Single) -> Single:
    """(k, c) mean of what was seen of each texel, else `unseen` (k, c), or what is around it."""
    count = stack.seen.sum(0)[:, None]
    total = (stack.colours * stack.seen[..., None]).sum(0)
    mean = np.where(count > 0, total / np.maximum(count, 1), unseen).astype(np.float32)
    at = (shape.atlas.rows, shape.atlas.columns)
    image = np.zeros((shape.atlas.size, shape.atlas.size, mean.shape[1]), np.float32)
    known = np.zeros(image.shape[:2], bool)
    known[at] = np.isfinite(mean[:, 0])
    image[at] = np.nan_to_num(mean)
    return fill(image, known)[at]


def luma_modes(stack: Stack, mean: Single, count: int) -> Single:
    """(count, k) leading modes of a stack of luma about `mean` (k, 1), for tracking."""
    if not count:
        return np.zeros((0, len(mean)), np.float32)
    residual = (stack.colours - mean)[..., 0] * stack.seen
    root = np.sqrt(np.maximum(stack.weight, 1e-6))
    rows = np.asarray(residual * root, np.float32)
    # Frames are few and texels many: of the frames' inner products rather than by an SVD.
    _, vectors = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    modes = vectors[:, : -count - 1 : -1].T.astype(np.float32) @ rows
    lengths = np.maximum(np.linalg.norm(modes, axis=1, keepdims=True), 1e-6)
    return np.asarray(modes / lengths / root, np.float32)


def template_of(stack: Stack, mean: Single, modes: Single) -> Template:
    """The tracking template of a mean (k, 1) and modes (m, k), luma."""
    return Template(mean[:, 0], modes, stack.weight)
