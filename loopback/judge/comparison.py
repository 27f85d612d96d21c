"""A decoded video beside its source: all figures that are measured of it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np

from encoder.capture.video_source import open_source
from loopback.judge.ffmpeg import find_ffmpeg, vmaf
from loopback.judge.identity import face_crop, find_recogniser, mean_likeness
from loopback.judge.learned import learned_distance
from loopback.judge.observer import MediaPipeJudge, Observer
from loopback.judge.voice import VoiceQuality, compare_voices
from loopback.quality.emotion_agreement import emotion_agreement
from loopback.quality.landmark_metrics import (
    LandmarkMetrics,
    frames_of_blinks,
    landmark_metrics,
)
from loopback.quality.region_quality import FRAME_INTERVAL, region_meter
from loopback.quality.video_quality import (
    Progress,
    Quality,
    face_oval_mask,
    measure_quality,
)
from loopback.report import figures_of, rounded
from shared_model.arrays import Array, Mask, Picture

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

    identity: mean cosine of the features of a face recognition network, of the same moments; other
        people's are below .5, the same person's at another time .8 to .95.
    emotion_agreement: share of the frames that show the source's emotion, see `emotion_agreement`.
    vmaf: of the whole picture, mean, 0 to 100, where an `ffmpeg` has it.
    lpips, dists: of the whole picture, every tenth frame, where the user has named a network.
    judge: who has found face and person.  judge_is_independent: the encoder does not use it.
    """

    quality: Quality
    faces: LandmarkMetrics
    identity: float | None
    emotion_agreement: float | None
    vmaf: float | None
    lpips: float | None
    dists: float | None
    voice: VoiceQuality
    judge: str
    judge_is_independent: bool

    def figures(self) -> dict[str, Any]:
        """All figures by name, those of its parts among them."""
        return figures_of(self)


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
    with_vmaf: bool = False,
    networks: Mapping[str, Path] = MappingProxyType({}),
) -> Comparison:
    """Measure a decoded video against its source.

    observer: of the view.  with_faces: look for the landmarks of the decoded video, too.
    with_voice: compare the sound, too, that of the whole files.  with_vmaf: measure VMAF.
    networks: of `lpips` and `dists`, see `learned_distance`.
    warn: called with a line for what cannot be measured.
    Raises `UserError` if the two differ in size or number of frames.
    """
    quality = measure_quality(
        view.source,
        decoded,
        view.face_masks(),
        progress,
        view.max_frames,
        regions=region_meter(view.people, warn, view.interval, frames_of_blinks(view.landmarks)),
        with_ssim=with_faces,
    )
    faces, identity, emotions = LandmarkMetrics(), None, None
    if with_faces:
        found = observer.landmarks(_pictures(decoded, view.max_frames))
        if np.isfinite(view.landmarks).any():
            size = (round(view.size[0] * view.aspect), view.size[1])
            faces = landmark_metrics(view.landmarks[: len(found)], found, size)
            identity = _identity(view, decoded, found, observer)
            emotions = emotion_agreement(view.landmarks[: len(found)], found, size)
    voice = compare_voices(view.source, decoded, observer) if with_voice else VoiceQuality()
    similar = _vmaf(view, decoded) if with_vmaf else None
    distances = {
        name: rounded(learned_distance(name, path, observer, _pairs(view, decoded), view.size), 4)
        for name, path in networks.items()
    }
    return Comparison(
        quality,
        faces,
        identity=rounded(identity, 3),
        emotion_agreement=emotions,
        vmaf=rounded(similar),
        lpips=distances.get("lpips"),
        dists=distances.get("dists"),
        voice=voice,
        judge=observer.name,
        judge_is_independent=observer.is_independent,
    )


def _pairs(view: SourceView, decoded: str) -> Iterator[tuple[Picture, Picture]]:
    """Every `interval`-th picture of both, as they are."""
    some = view.max_frames, view.interval, False
    return zip(_pictures(view.source, *some), _pictures(decoded, *some), strict=False)


def _vmaf(view: SourceView, decoded: str) -> float | None:
    program = find_ffmpeg("filters", "libvmaf")
    if program is None:
        return None
    originals, copies = (
        _pictures(name, view.max_frames, is_square=False) for name in (view.source, decoded)
    )
    return vmaf(program, originals, copies, view.size)


def _identity(view: SourceView, decoded: str, found: Array, observer: Observer) -> float | None:
    """See `Comparison`; None where the judge has no such network.  found: landmarks, decoded."""
    recogniser = find_recogniser(observer.python) if isinstance(observer, MediaPipeJudge) else None
    if recogniser is None:
        return None
    crops: tuple[list[Picture], list[Picture]] = [], []
    pictures = (_pictures(name, view.max_frames, view.interval) for name in (view.source, decoded))
    landmarks = view.landmarks[:: view.interval], found[:: view.interval]
    for picture, copy, *points in zip(*pictures, *landmarks, strict=False):
        if all(np.isfinite(each[0, 0]) for each in points):
            crops[0].append(face_crop(picture, points[0]))
            crops[1].append(face_crop(copy, points[1]))
    if not crops[0]:
        return None
    features = recogniser.features([*crops[0], *crops[1]])
    return mean_likeness(features[: len(crops[0])], features[len(crops[0]) :])


def _pictures(
    source: str, max_frames: int | None, interval: int = 1, is_square: bool = True
) -> Iterator[Picture]:
    """Every `interval`-th picture of a video, in square pixels, or as it is."""
    with open_source(source, square_pixels=is_square) as capture:
        for index, picture in capture:
            if index == max_frames:
                return
            if index % interval == 0:
                yield picture


def _at_size(mask: Mask, size: tuple[int, int]) -> Mask:
    if mask.shape == size[::-1]:
        return mask
    return cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
