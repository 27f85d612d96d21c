"""Eyelids from frame to frame: the iris network is run on one eye after the other.

For both eyes it takes twice as long as the face mesh for the whole face.  Most of the time eyelids
rest, and people shut both eyes: the network sees one eye in each frame, and the other one as well
if that looks different from when it was seen last, or if the first one has opened or closed.  One
that is not seen opens and closes by as much as the other: lids that move in turn would take bits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma_f32
from encoder.detection.iris import EyeView, IrisLandmarker, with_eyelid_margins

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Frame = NDArray[np.uint8]

# Change of an eye's picture, mean over `COMPARED` rows and columns in standard deviations of the
# whole, and change of the other eye's aperture, in widths of the eye, above which the network sees
# it at once.  Without the second limit apertures of nine clips were off by up to .12 (blinks: .25),
# with both by up to .06, and 52 to 81 % of the eyes were seen.
MAX_CHANGE, MAX_APERTURE_CHANGE = 0.15, 0.02
COMPARED = slice(12, 52)
# By how much an eye that rests may open with the other one.
OPENING_LIMITS = 0.67, 1.5
# An aperture below this is that of a closed eye, widths of the eye.
MIN_APERTURE = 0.01
# Contrast below this, grey levels, is noise.
MIN_CONTRAST_GREY = 4.0


@dataclass(frozen=True, slots=True)
class _SeenEye:
    """An eye as the network saw it last.

    luma: (INPUT_PX, INPUT_PX) of its crop.  contour: (71, 2) pixels of the crop.
    is_old: it was not seen in the newest frame.
    """

    luma: Single
    contour: Array
    is_old: bool = False

    @property
    def aperture(self) -> float:
        """Distance of the eyelids, in widths of the eye."""
        across = self.contour[1:8].mean(0) - self.contour[9:16].mean(0)
        return float(np.linalg.norm(across) / np.linalg.norm(self.contour[0] - self.contour[8]))

    def opened(self, ratio: float) -> "_SeenEye":
        """The eye with another aperture, a multiple of its own: lids move away from its corners."""
        across = self.contour[8] - self.contour[0]
        along = across / np.linalg.norm(across)
        offset = self.contour - self.contour[0]
        on_axis = (offset @ along)[:, None] * along
        factor = float(np.clip(ratio, *OPENING_LIMITS))
        return replace(self, contour=self.contour[0] + on_axis + factor * (offset - on_axis))

    def looks_like(self, luma: Single) -> bool:
        """Whether a crop shows much the same, but for the brightness."""
        difference = luma - luma.mean() - (self.luma - self.luma.mean())
        contrast = max(float(self.luma.std()), MIN_CONTRAST_GREY)
        return float(np.abs(difference[COMPARED, COMPARED]).mean()) < MAX_CHANGE * contrast


class EyelidTracker:
    """Replaces the eyelids of face-mesh landmarks, frame by frame.

    alternates: rest one eye where the other tells enough, see above; otherwise see both.
    """

    def __init__(self, landmarker: IrisLandmarker, alternates: bool) -> None:
        self._landmarker, self._alternates = landmarker, alternates
        self._seen: tuple[_SeenEye, _SeenEye] | None = None
        self._resting_side = 0

    def reset(self) -> None:
        """The next frame is not of the same face."""
        self._seen = None

    def replace_eyelids(self, frame: Frame, points: Array) -> Array:
        """See `IrisLandmarker.replace_eyelids`.  A contour that is not new moves with the eye.

        Its lids move with those of the other eye.
        """
        views = self._landmarker.views(frame, points)
        lumas = [luma_f32(view.crop) for view in views]
        before, side = self._seen, self._resting_side
        first = self._see(views[1 - side], lumas[1 - side])
        if before is not None and self._rests(before, side, first, lumas[side]):
            ratio = first.aperture / max(before[1 - side].aperture, MIN_APERTURE)
            second = replace(before[side].opened(ratio), is_old=True)
        else:
            second = self._see(views[side], lumas[side])
        self._seen = (first, second) if side else (second, first)
        self._resting_side = 1 - side
        contours = [view.to_frame(eye.contour) for view, eye in zip(views, self._seen, strict=True)]
        return with_eyelid_margins(points, contours)

    def _see(self, view: EyeView, luma: Single) -> _SeenEye:
        return _SeenEye(luma, self._landmarker.contour(view))

    def _rests(self, before: Sequence[_SeenEye], side: int, other: _SeenEye, luma: Single) -> bool:
        """Whether the eye of `side` is as it was seen last.  other: the other eye, seen now."""
        if not self._alternates or before[side].is_old:
            return False
        change = abs(other.aperture - before[1 - side].aperture)
        return change < MAX_APERTURE_CHANGE and before[side].looks_like(luma)
