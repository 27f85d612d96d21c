"""Masks and weights of texels: which belong to the face, and how much errors there count."""

from collections.abc import Sequence

import cv2
import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.capture.face_crop import Crop
from encoder.detection.landmark_indices import FACE_OVAL, face_outline
from runtime.image_ops import hull_mask, sample_bicubic
from runtime.parallel import parallel_map
from shared_model.appearance import Atlas
from shared_model.arrays import Array, Mask, Single
from shared_model.mesh import OUTER_LIPS, PARTS, Head
from shared_model.parameters import FaceParameters

# Weight of texels outside the face's outline: hair and neck.
OUTSIDE_WEIGHT = 0.03
# Standard deviation of the blur of a mask's edge, in terms of the atlas' side.
EDGE_SIGMA = 0.015
# Weight of squared errors in the mouth and on the lips, since viewers read lips.
MOUTH_WEIGHT = 2.5
# The outline of a small face may be a pixel off: so many pixels around it belong to the face.
OUTLINE_MARGIN_PX = 1.0


def face_mask(head: Head, atlas: Atlas) -> Single:
    """(k,) 1 within the face's outline and in the mouth, smoothly `OUTSIDE_WEIGHT` beyond."""
    mask = np.maximum(_soft_hull(head, atlas, FACE_OVAL), OUTSIDE_WEIGHT)
    return np.where(_is_mouth(head, atlas), 1, mask).astype(np.float32)


def mouth_weights(head: Head, atlas: Atlas) -> Single:
    """(k,) `MOUTH_WEIGHT` in the mouth and on the lips, smoothly 1 elsewhere."""
    mouth = np.where(_is_mouth(head, atlas), 1, _soft_hull(head, atlas, OUTER_LIPS))
    return (1 + (MOUTH_WEIGHT - 1) * mouth).astype(np.float32)


def _soft_hull(head: Head, atlas: Atlas, landmarks: Sequence[int]) -> Single:
    """(k,) 1 within the convex hull of the landmarks on the atlas, smoothly 0 beyond."""
    chosen = list(landmarks)
    corners = head.triangles[head.network_triangles[chosen]]
    points = np.einsum(
        "mc,mcd->md", head.network_weights[chosen], head.texture_coordinates[corners]
    )
    mask = hull_mask(points * atlas.size - 0.5, (atlas.size, atlas.size))
    soft = cv2.GaussianBlur(mask, (0, 0), max(0.5, EDGE_SIGMA * atlas.size))
    return np.asarray(np.clip(2 * soft[atlas.rows, atlas.columns], 0, 1), np.float32)


def _is_mouth(head: Head, atlas: Atlas) -> Mask:
    """(k,) whether each texel belongs to the cavity of the mouth."""
    return np.asarray(head.parts[atlas.corners[:, 0]] == PARTS.index("mouth"))


def outline_coverage(
    shape_free: ShapeFreeFrame,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    landmarks: Sequence[Array],
    workers: int | None = None,
) -> Single:
    """(k,) share of the frames in which each texel lies within the outline of the landmarks.

    The outline is widened by `OUTLINE_MARGIN_PX`.
    landmarks: of each frame, (468, >= 2) pixels.  workers: see `parallel_map`.
    """

    def inside(view: tuple[Crop, FaceParameters, Array]) -> Single:
        crop, face, points = view
        outline = face_outline(points)
        outward = outline - outline.mean(0)
        lengths = np.linalg.norm(outward, axis=1, keepdims=True)
        wider = outline + OUTLINE_MARGIN_PX * outward / np.maximum(lengths, 1.0)
        height, width = crop.picture.shape[:2]
        mask = hull_mask(crop.to_crop_px(wider.astype(np.float32)), (height, width))
        positions = crop.to_crop_px(shape_free.positions(face))
        return sample_bicubic(mask, positions)[:, 0].clip(0, 1)

    count = np.zeros(len(shape_free), np.float32)
    for each in parallel_map(inside, zip(crops, faces, landmarks, strict=True), workers):
        count += each
    return count / np.float32(max(len(crops), 1))


def root_weight_and_support(weight: Single, mask: Single) -> tuple[Single, Single]:
    """(k, 1) roots of the weights of squared errors, and (k, 1) the support of modes.

    Modes do not reach beyond the soft edge of the face.
    weight: (k,).  mask: (k,) see `face_mask`.
    """
    root = np.sqrt(np.maximum(weight, 1e-6))
    return root[:, None], np.where(mask > 2 * OUTSIDE_WEIGHT, mask, 0)[:, None]
