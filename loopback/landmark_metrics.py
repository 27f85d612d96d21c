"""Whether a decoded face does what its source does: landmarks, mouth, brows and lids of both."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.capture.video_source import open_source
from encoder.detection.landmark_indices import LANDMARK_COUNT, LANDMARK_DISTANCES, OUTER_EYE_CORNERS
from encoder.detection.landmarks import open_landmark_tracker
from encoder.detection.tflite import NetworkFilesMissing
from loopback.report import rounded

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LandmarkMetrics:
    """How alike two videos of a face are; figures are None where nothing can be said.

    face_found: share of the frames with a face whose copy has one as well.
    nme_percent: mean distance between the landmarks of both, percent of the eyes' distance.
    *_corr: correlation over time of the mouth's opening, the brows' height and the eyes' opening.
    """

    face_found: float | None = None
    nme_percent: float | None = None
    mouth_corr: float | None = None
    brow_corr: float | None = None
    blink_corr: float | None = None


def compare_faces(source: str, decoded: str, max_frames: int | None = None) -> LandmarkMetrics:
    """Follow the face in both videos and compare.

    source, decoded: anything `open_source` opens, of equally many frames.
    max_frames: the part of the source that was encoded.
    Nothing can be said where the landmark network is not installed.
    """
    try:
        first, second = (face_points(name, max_frames) for name in (source, decoded))
    except NetworkFilesMissing:
        return LandmarkMetrics()
    return landmark_metrics(first, second)


def face_points(source: str, max_frames: int | None) -> Array:
    """(t, 468, 2) landmarks of each frame, pixels, nan where there is no face.

    Raises `NetworkFilesMissing`.
    """
    return np.array(list(_tracked_points(source, max_frames))).reshape(-1, LANDMARK_COUNT, 2)


def landmark_metrics(source: Array, decoded: Array) -> LandmarkMetrics:
    """Compare landmarks (t, 468, 2) of two videos; nan: no face."""
    there, kept = (np.isfinite(points[:, 0, 0]) for points in (source, decoded))
    both = there & kept
    if not both.any():
        return LandmarkMetrics(face_found=0.0 if there.any() else None)
    a, b = source[both], decoded[both]
    distance = np.linalg.norm(a - b, axis=2).mean(1) / _eye_distance(a)
    gaps = {
        name: correlation(_landmark_distance(a, name), _landmark_distance(b, name))
        for name in LANDMARK_DISTANCES
    }
    return LandmarkMetrics(
        face_found=rounded(float(kept[there].mean()), 3),
        nme_percent=rounded(100 * float(distance.mean())),
        mouth_corr=gaps["mouth"],
        brow_corr=gaps["brow"],
        blink_corr=gaps["blink"],
    )


def correlation(first: Array, second: Array) -> float | None:
    """Pearson's, of two signals; None if one of them stands still."""
    if len(first) < 3 or min(first.std(), second.std()) < 1e-6:
        return None
    return rounded(float(np.corrcoef(first, second)[0, 1]), 3)


def _tracked_points(source: str, max_frames: int | None) -> Iterator[Array]:
    tracker = open_landmark_tracker()
    nothing = np.full((LANDMARK_COUNT, 2), np.nan)
    with open_source(source) as capture:
        for index, frame in capture:
            if index == max_frames:
                return
            found = tracker.update(frame)
            yield nothing if found is None else found.points[:, :2]


def _eye_distance(points: Array) -> Array:
    left, right = (points[:, corner] for corner in OUTER_EYE_CORNERS)
    return np.asarray(np.linalg.norm(left - right, axis=1))


def _landmark_distance(points: Array, name: str) -> Array:
    """(t,) how far the gesture is open, in the eyes' distance."""
    gaps = [
        np.linalg.norm(points[:, a] - points[:, b], axis=1) for a, b in LANDMARK_DISTANCES[name]
    ]
    return np.asarray(np.mean(gaps, axis=0) / _eye_distance(points))
