"""Eyelids from frame to frame: for one eye the iris network takes as long as the face mesh."""

from dataclasses import dataclass

import numpy as np

from encoder.detection.iris import IrisLandmarker
from encoder.detection.landmark_indices import EYE_CORNER_PAIRS, EYELID_MARGINS
from shared_model.arrays import Array, Picture

# Both eyes are looked at where the face mesh sees a lid move by more than this from one frame to
# the next, in widths of the eye; elsewhere one after the other.  Of nine clips, 3 to 37 % of the
# frames; the aperture of the other eye is off by .005 to .013 then, as much as the network's noise.
MAX_LID_MOTION = 0.02
# Lower and upper points of `EYELID_MARGINS`, without those beside the corners.
_LOWER, _UPPER = slice(1, 6), slice(8, 13)


@dataclass(frozen=True, slots=True)
class Eyelids:
    """What the eyelids of the next frame begin with.

    corrections: (2, 14, 2) pixels by which the iris network's `EYELID_MARGINS` are off the face
        mesh's, the subject's right eye first.
    apertures: (2,) of the face mesh, in widths of the eye.
    next_side: the eye whose turn it is.
    """

    corrections: Array
    apertures: Array
    next_side: int


def eyelids_of_frame(
    eyes: IrisLandmarker, frame: Picture, points: Array, before: Eyelids | None
) -> tuple[Array, Eyelids]:
    """The landmarks (468, 3) with the eyelid margins of the iris network, see `replace_eyelids`.

    points: of the face mesh in `frame` (h, w, 3) uint8 BGR, pixels.
    before: of the frame before: where no lid moves, one eye keeps the correction that it had.
    None: both eyes are looked at.
    """
    apertures = np.array([_aperture(points, side) for side in range(2)])
    looked_at, corrections, next_side = [0, 1], np.zeros((2, 14, 2)), 0
    if before is not None:
        corrections, next_side = before.corrections.copy(), before.next_side
        if np.abs(apertures - before.apertures).max() <= MAX_LID_MOTION:
            looked_at = [next_side]
    replaced = points.copy()
    for side in looked_at:
        found = eyes.margins(frame, points, side)
        corrections[side] = found - points[list(EYELID_MARGINS[side]), :2]
    for margin, correction in zip(EYELID_MARGINS, corrections, strict=True):
        replaced[list(margin), :2] += correction
    return replaced, Eyelids(corrections, apertures, 1 - next_side)


def _aperture(points: Array, side: int) -> float:
    """Mean height of an eye between its lids, in terms of its width."""
    margin = points[list(EYELID_MARGINS[side]), :2]
    outer, inner = points[list(EYE_CORNER_PAIRS[side]), :2]
    height = float(np.linalg.norm((margin[_LOWER] - margin[_UPPER]).mean(0)))
    return height / max(float(np.linalg.norm(inner - outer)), 1e-9)
