"""A decoded video beside its source: all figures that are measured of it."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.capture.video_source import open_source
from loopback.judge.observer import Observer
from loopback.judge.voice import VoiceQuality, compare_voices
from loopback.quality.landmark_metrics import LandmarkMetrics, landmark_metrics
from loopback.quality.region_quality import FRAME_INTERVAL, region_meter
from loopback.quality.video_quality import (
    Progress,
    Quality,
    face_oval_mask,
    measure_quality,
)

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Warn = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class SourceView:
    """A source as its observer sees it; it serves for any number of decoded videos.

    size: (width, height) of its pictures.  aspect: of a sample.
    landmarks: (t, 468, 3) in square pixels, nan: no face.
    people: (h, w) bool in every `interval`-th frame; None: not known.
    max_frames: the part that is looked at; None: all.
    """

    source: str
    size: tuple[int, int]
    aspect: Fraction
    landmarks: Array
    people: list[Mask] | None
    interval: int
    max_frames: int | None

    def face_masks(self) -> Callable[[Picture], Mask | None]:
        """A `FaceMaskFinder` for its frames in their order."""
        remaining = iter(self.landmarks)

        def find(picture: Picture) -> Mask | None:
            points = next(remaining, None)
            if points is None or not np.isfinite(points[0, 0]):
                return None
            return face_oval_mask(points, *picture.shape[:2])

        return find


@dataclass(frozen=True, slots=True)
class Comparison:
    """The figures of a decoded video.

    judge: who has found face and person.  is_independent: the encoder does not use it.
    """

    judge: str
    is_independent: bool
    quality: Quality
    faces: LandmarkMetrics
    voice: VoiceQuality

    def figures(self) -> dict[str, Any]:
        """All figures by name, and the judge."""
        judge = {"judge": self.judge, "judge_is_independent": self.is_independent}
        return {**self.quality.figures(), **asdict(self.faces), **asdict(self.voice), **judge}


def observe_source(
    source: str,
    observer: Observer,
    max_frames: int | None = None,
    interval: int = FRAME_INTERVAL,
) -> SourceView:
    """Look at a source, anything `open_source` opens that can be read again.

    interval: every so many frames the person is looked for.  Raises `UserError`.
    """
    with open_source(source) as capture:
        size, aspect = (capture.width, capture.height), capture.sample_aspect
    landmarks = observer.landmarks(_pictures(source, max_frames))
    people = observer.people(_pictures(source, max_frames, interval))
    masks = None if people is None else [_at_size(mask, size) for mask in people]
    return SourceView(source, size, aspect, landmarks, masks, interval, max_frames)


def compare(
    view: SourceView,
    decoded: str,
    observer: Observer,
    progress: Progress,
    warn: Warn,
    with_faces: bool = True,
    with_voice: bool = False,
) -> Comparison:
    """Measure a decoded video against its source.

    observer: of the view.  with_faces: look for the landmarks of the decoded video, too.
    with_voice: compare the sound, too, that of the whole files.
    warn: called with a line for what cannot be measured.
    Raises `UserError` if the two differ in size or number of frames.
    """
    quality = measure_quality(
        view.source,
        decoded,
        view.face_masks(),
        progress,
        view.max_frames,
        regions=region_meter(view.people, warn, view.interval),
        with_ssim=with_faces,
    )
    faces = LandmarkMetrics()
    if with_faces:
        found = observer.landmarks(_pictures(decoded, view.max_frames))
        if np.isfinite(view.landmarks).any():
            size = (round(view.size[0] * view.aspect), view.size[1])
            faces = landmark_metrics(view.landmarks[: len(found)], found, size)
    voice = compare_voices(view.source, decoded, observer) if with_voice else VoiceQuality()
    return Comparison(observer.name, observer.is_independent, quality, faces, voice)


def _pictures(source: str, max_frames: int | None, interval: int = 1) -> Iterator[Picture]:
    """Every `interval`-th picture of a video, in square pixels."""
    with open_source(source, square_pixels=True) as capture:
        for index, picture in capture:
            if index == max_frames:
                return
            if index % interval == 0:
                yield picture


def _at_size(mask: Mask, size: tuple[int, int]) -> Mask:
    if mask.shape == size[::-1]:
        return mask
    return cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
