"""Quality of what surrounds the face: the person, what is behind, and how the picture looks.

Looked at in every tenth frame, since SSIMULACRA2 and segmentation take their time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import cv2
import numpy as np

from encoder.capture.colour import luma_u8
from loopback.quality.psnr import psnr_db
from loopback.report import rounded
from shared_model.arrays import Array, Mask, Picture

# SSIMULACRA2 of a copy beside its original.
Similarity = Callable[[Picture, Picture], float]

FRAME_INTERVAL = 10
# Pixels around the face that its SSIMULACRA2 looks at.
FACE_MARGIN_PX = 4
# A source that stands stiller than this is taken for one that flickers this much, grey levels.
LEAST_FLICKER = 0.05


@dataclass(frozen=True, slots=True)
class RegionQuality:
    """Means over every tenth frame, of blinks over all; None for what could not be measured.

    person_psnr_db: PSNR of luma (eq. 6.1) over the person in the source outside the face: hair,
        ears, neck, shoulders.
    background_psnr_db: over all that is neither person nor face.
    face_ssimulacra2: SSIMULACRA2 of the face's bounding box, with the source's pixels around the
        face.
    blink_ssimulacra2: of the face as above, in all frames in which lids move or are closed.
    picture_ssimulacra2: of the whole picture.  90 looks lossless, 70 high, 50 medium, 30 low.
    flicker_ratio: mean change of the background from one looked-at frame to the next, decoded over
        source; 1 is as calm as the source.
    """

    person_psnr_db: float | None = None
    background_psnr_db: float | None = None
    face_ssimulacra2: float | None = None
    blink_ssimulacra2: float | None = None
    picture_ssimulacra2: float | None = None
    flicker_ratio: float | None = None


@dataclass(slots=True)
class RegionMeter:
    """Collects the figures of one video.

    people: the person in each frame that is looked at, (height, width); None leaves out person,
        background and flicker.
    similarity: None leaves out SSIMULACRA2.
    interval: every so many frames one is looked at, besides those of blinks.
    blinks: of each frame whether lids move or are closed in it; None: not known.
    """

    people: Sequence[Mask] | None
    similarity: Similarity | None
    interval: int = FRAME_INTERVAL
    blinks: Mask | None = None
    _values: dict[str, list[float]] = field(default_factory=dict)
    _changes: list[tuple[float, float]] = field(default_factory=list)
    _before: tuple[Array, Array, Mask] | None = None

    def add(self, index: int, original: Picture, copy: Picture, face: Mask | None) -> None:
        """Measure frame `index`, if it is its turn.

        original, copy: (height, width, 3) uint8 BGR.  face: mask of the face in `original`.
        """
        is_regular = index % self.interval == 0
        is_blink = self.blinks is not None and bool(self.blinks[index])
        face = np.zeros(original.shape[:2], np.bool_) if face is None else face
        if is_regular and self.people is not None:
            self._add_regions(original, copy, face, self.people[index // self.interval])
        if self.similarity is None:
            return
        if is_regular:
            self._add("picture_ssimulacra2", self.similarity(original, copy))
        if face.any() and (is_regular or is_blink):
            similarity = self.similarity(*_face_only(original, copy, face))
            for name, is_shown in (("face", is_regular), ("blink", is_blink)):
                if is_shown:
                    self._add(f"{name}_ssimulacra2", similarity)

    def result(self) -> RegionQuality:
        """The means over the frames added."""
        means = {name: rounded(float(np.mean(values))) for name, values in self._values.items()}
        return RegionQuality(**means, flicker_ratio=self._flicker_ratio())

    def _add_regions(self, original: Picture, copy: Picture, face: Mask, person: Mask) -> None:
        lumas = luma_u8(original).astype(np.float64), luma_u8(copy).astype(np.float64)
        error = (lumas[0] - lumas[1]) ** 2
        behind = ~(person | face)
        for name, region in (("person", person & ~face), ("background", behind)):
            if region.any():
                self._add(f"{name}_psnr_db", psnr_db(error[region]))
        if self._before is not None and (both := behind & self._before[2]).any():
            changes = [np.abs(lumas[i] - self._before[i])[both].mean() for i in (0, 1)]
            self._changes.append((float(changes[0]), float(changes[1])))
        self._before = (*lumas, behind)

    def _flicker_ratio(self) -> float | None:
        if not self._changes:
            return None
        source, decoded = np.mean(self._changes, axis=0)
        return rounded(float(decoded / max(source, LEAST_FLICKER)))

    def _add(self, name: str, value: float) -> None:
        self._values.setdefault(name, []).append(value)


def region_meter(
    people: Sequence[Mask] | None,
    warn: Callable[[str], None],
    interval: int = FRAME_INTERVAL,
    blinks: Mask | None = None,
) -> RegionMeter:
    """A meter with what is installed; `warn` is called with a line for each part that is not.

    people: the person in each frame that is looked at; None: not known.  blinks: see `RegionMeter`.
    """
    if people is None:
        warn("risorius: warning: no segmentation network: no PSNR of person and background")
    similarity = _ssimulacra2()
    if similarity is None:
        warn("risorius: warning: no SSIMULACRA2; pip install '.[quality]' brings it")
    return RegionMeter(people, similarity, interval, blinks)


def _ssimulacra2() -> Similarity | None:
    try:
        from ssimulacra2 import compute_ssimulacra2
    except ImportError:
        return None
    compute: Any = compute_ssimulacra2
    return lambda original, copy: float(compute(_as_png(original), _as_png(copy)))


def _as_png(picture: Picture) -> BytesIO:
    return BytesIO(cv2.imencode(".png", picture)[1].tobytes())


def _face_only(original: Picture, copy: Picture, face: Mask) -> tuple[Picture, Picture]:
    """The face's surroundings in the original, and the same with the face of the copy."""
    rows, columns = np.nonzero(face)
    box = tuple(
        slice(max(0, int(i.min()) - FACE_MARGIN_PX), int(i.max()) + FACE_MARGIN_PX + 1)
        for i in (rows, columns)
    )
    mixed = np.where(face[..., None], copy, original)
    return np.ascontiguousarray(original[box]), np.ascontiguousarray(mixed[box])
