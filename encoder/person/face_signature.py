"""Whether two pictures show the same face, by its looks alone: no network tells persons apart here.

Faces are laid on each other by an affine map of their landmarks, which takes up most of a turn of
the head, and shrunk.  Luma is compared by correlation, colour by the mean: within one call the
light stays, so that the tone of the skin is known to a few levels.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from encoder.detection.landmark_indices import OUTER_EYE_CORNERS
from runtime.area_resize import area_resized
from shared_model.arrays import Array, Picture

# Side of the face's picture, pixels, and of the face in it.
SIDE_PX, FACE_SHARE = 40, 0.96
NOSE_TIP = 1
# Standard deviation of the blur before a face is shrunk, pixels of its picture; what is left of it
# after a mean over as many pixels, whose variance is 1 / 12.
BLUR, BLUR_AFTER_MEAN = 0.6, 0.53
# A face is frontal if the tip of its nose is so near the middle between the eyes, in units of
# their distance.
FRONTAL = 0.22
# Two faces are others if the best of their correlations is below the first, and their colours are
# further apart than that (levels of a and b of L*a*b*); or if it is below the second.
# The second half of thirteen clips against the first: medians .41 (a turn to profile) and .68 to
# .99, colours up to 1.7, of two clips 2.6 and 5.3; between two clips at most .77, and at least 3.
SAME_CORRELATION, SAME_COLOUR, OTHER_CORRELATION = 0.8, 2.5, 0.4


@dataclass(frozen=True, slots=True)
class FaceSignature:
    """luma: (n,) of zero mean and length 1.  colour: (2,) mean a and b of L*a*b*."""

    luma: Array
    colour: Array


class SignatureMaker:
    """Makes comparable signatures.  points: (468, >= 2) landmarks of the first face, pixels."""

    def __init__(self, points: Array) -> None:
        low, high = points[:, :2].min(0), points[:, :2].max(0)
        scale = FACE_SHARE * SIDE_PX / float((high - low).max())
        self._template = (points[:, :2] - (low + high) / 2) * scale + (SIDE_PX - 1) / 2
        self._solver = np.linalg.pinv(np.column_stack([self._template, np.ones(len(points))]))
        outline = cv2.convexHull(self._template.astype(np.float32)).astype(np.int32)
        blank = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
        self._inside = np.asarray(cv2.fillConvexPoly(blank, outline, (1,))) > 0

    def make(self, picture: Picture, points: Array) -> FaceSignature:
        """Of a face in a picture (h, w, 3) BGR with these landmarks."""
        pixel_from_face = (self._solver @ points[:, :2]).T
        scale = float(np.sqrt(abs(np.linalg.det(pixel_from_face[:, :2]))))
        part, corner = _around(picture, points)
        pixel_from_face[:, 2] -= corner
        blur_px = BLUR * scale
        if scale >= 2:
            # A mean over areas is a part of the blur, and leaves a picture that is soon blurred.
            size = max(1, round(part.shape[1] / scale)), max(1, round(part.shape[0] / scale))
            shrink = np.array(size) / part.shape[1::-1]
            part, blur_px = area_resized(part, size), BLUR_AFTER_MEAN
            pixel_from_face *= shrink[:, None]
            pixel_from_face[:, 2] += 0.5 * (shrink - 1)
        if scale > 1:
            part = np.asarray(cv2.GaussianBlur(part, (0, 0), blur_px), np.uint8)
        face = cv2.warpAffine(
            part,
            pixel_from_face,
            (SIDE_PX, SIDE_PX),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        lab = cv2.cvtColor(face.astype(np.float32) / 255, cv2.COLOR_BGR2LAB)[self._inside]
        luma = lab[:, 0].astype(np.float64)
        luma -= luma.mean()
        length = float(np.linalg.norm(luma))
        return FaceSignature(luma / max(length, 1e-9), lab[:, 1:].mean(0).astype(np.float64))


def is_frontal(points: Array) -> bool:
    """Whether a face looks about into the camera.  points: (468, >= 2) landmarks, pixels."""
    right, left = (points[corner, :2] for corner in OUTER_EYE_CORNERS)
    along = left - right
    place = (points[NOSE_TIP, :2] - right) @ along / max(float(along @ along), 1e-9)
    return bool(abs(place - 0.5) < FRONTAL)


def are_others(known: Iterable[FaceSignature], seen: Iterable[FaceSignature]) -> bool:
    """Whether the faces seen are of somebody else than the known faces."""
    known, seen = list(known), list(seen)
    if not known or not seen:
        return False
    lumas = np.array([each.luma for each in known]) @ np.array([each.luma for each in seen]).T
    best = float(lumas.max())
    colours = [np.mean([each.colour for each in faces], axis=0) for faces in (known, seen)]
    apart = float(np.linalg.norm(colours[0] - colours[1]))
    return best < OTHER_CORRELATION or (best < SAME_CORRELATION and apart > SAME_COLOUR)


def _around(picture: Picture, points: Array) -> tuple[Picture, Array]:
    """The part of a picture with the face, and its upper left corner (2,)."""
    height, width = picture.shape[:2]
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    margin = 0.25 * (high - low)
    left, top = np.clip(low - margin, 0, [width - 2, height - 2]).astype(int)
    right, bottom = np.clip(high + margin, [left + 2, top + 2], [width, height]).astype(int)
    return picture[top:bottom, left:right], np.array([left, top], np.float64)
