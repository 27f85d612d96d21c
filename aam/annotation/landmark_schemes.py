"""Landmark schemes: which of the 468 network landmarks each landmark of a scheme is.

The head knows where the network's landmarks lie on its mesh, so a scheme of other landmarks needs
no more than this table.  Landmarks without a counterpart, as pupils, are left out.
"""

from dataclasses import dataclass

import numpy as np

from encoder.detection.landmark_indices import FACE_OVAL, LANDMARK_COUNT
from shared_model.arrays import Array

# Factor on the standard deviation of landmarks on the outline of the face, which slide along it.
OUTLINE_SIGMA = 4.0
# Index of a landmark without counterpart.
NONE = -1

# 68 landmarks in the order of iBUG's annotations (300-W).
IBUG_68 = (
    *(162, 234, 93, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 323, 454, 389),
    *(70, 63, 105, 66, 107, 336, 296, 334, 293, 300),
    *(168, 197, 5, 4, 98, 97, 2, 326, 327),
    *(33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380),
    *(61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181),
    *(78, 81, 13, 311, 308, 402, 14, 178),
)
# 73 landmarks of the .asf files of IMM's format: brows, eyes, pupils, nose, mouth, jaw.
IMM_73 = (
    *(70, 63, 105, 66, 107, 65, 52, 53),
    *(300, 283, 282, 295, 336, 296, 334, 293),
    *(33, 160, 159, 158, 133, 154, 145, 144),
    *(263, 373, 374, 381, 362, 385, 386, 387),
    *(NONE, NONE),
    *(NONE, NONE, 358, 327, NONE, 2, NONE, 98, 129, NONE, NONE, 4),
    *(61, 40, 37, 0, 267, 270, 291, 405, 17, 181),
    *(81, 13, 311, 178, 14, 402),
    *(93, 58, 172, 136, 149, 152, 378, 365, 397, 288, 323),
)
SCHEMES = {len(IBUG_68): IBUG_68, len(IMM_73): IMM_73}


@dataclass(frozen=True, slots=True)
class FaceLandmarks:
    """Landmarks of one face in a picture.

    points: (468, 3) pixels, in the order of the landmark network; nan where unknown.  The third
        coordinate is the network's depth, pixels, nan if there is none.
    sigma: (468,) factor on the standard deviation of each.
    """

    points: Array
    sigma: Array


def from_search(points: Array) -> FaceLandmarks:
    """Landmarks (468, 3) of the network, or of a model."""
    return FaceLandmarks(points, np.ones(LANDMARK_COUNT))


def from_given(points: Array) -> FaceLandmarks:
    """Landmarks (m, 2), pixels, of a scheme that their number tells.

    Raises `ValueError` for a number that no scheme has.
    """
    if len(points) == LANDMARK_COUNT:
        full = np.column_stack([points[:, :2], np.full(LANDMARK_COUNT, np.nan)])
        return FaceLandmarks(full, np.ones(LANDMARK_COUNT))
    if len(points) not in SCHEMES:
        known = ", ".join(map(str, [*SCHEMES, LANDMARK_COUNT]))
        raise ValueError(f"{len(points)} landmarks, expected {known}")
    scheme = np.array(SCHEMES[len(points)])
    full, sigma = np.full((LANDMARK_COUNT, 3), np.nan), np.ones(LANDMARK_COUNT)
    full[scheme[scheme != NONE], :2] = points[scheme != NONE]
    sigma[list(FACE_OVAL)] = OUTLINE_SIGMA
    return FaceLandmarks(full, sigma)


def from_known(points: Array) -> FaceLandmarks:
    """The landmarks (468, 3) that an annotation keeps: of a search, or of a scheme if few."""
    sigma = np.ones(LANDMARK_COUNT)
    if np.isfinite(points[:, 0]).sum() <= max(SCHEMES):
        sigma[list(FACE_OVAL)] = OUTLINE_SIGMA
    return FaceLandmarks(points, sigma)
