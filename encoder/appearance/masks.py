"""How much each texel counts."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFree
from encoder.appearance.texture import sample
from encoder.capture.face_crop import Crop
from encoder.detection.landmark_indices import OUTLINE, outline_of
from encoder.runtime.image_ops import hull_mask
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


def weighting(weight: Single, mask: Single) -> tuple[Single, Single]:
    """(k, 1) roots of what errors count, and where modes paint how much.

    weight: (k,) see `Caller`.  mask: see `face_mask`.
    """
    root = np.sqrt(np.maximum(weight, 1e-6))
    return root[:, None], np.where(mask > 2 * OUTSIDE, mask, 0)[:, None]
