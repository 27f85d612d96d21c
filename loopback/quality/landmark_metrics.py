"""Landmarks of a decoded face against those of its source, and the motion of mouth, brows, lids."""

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
    """Agreement of two videos of a face; a figure is None if it cannot be measured.

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
    """Find the landmarks in both videos and compare them.

    source, decoded: anything `open_source` opens, of equally many frames.
    max_frames: the part of the source that was encoded.
    Without the landmark networks there are no figures.
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
    in_source, in_decoded = (np.isfinite(points[:, 0, 0]) for points in (source, decoded))
    both = in_source & in_decoded
    if not both.any():
        return LandmarkMetrics(face_found=0.0 if in_source.any() else None)
    a, b = source[both], decoded[both]
    distance = np.linalg.norm(a - b, axis=2).mean(1) / _eye_distance(a)
    correlations = {
        name: correlation(_landmark_distance(a, name), _landmark_distance(b, name))
        for name in LANDMARK_DISTANCES
    }
    return LandmarkMetrics(
        face_found=rounded(float(in_decoded[in_source].mean()), 3),
        nme_percent=rounded(100 * float(distance.mean())),
        mouth_corr=correlations["mouth"],
        brow_corr=correlations["brow"],
        blink_corr=correlations["blink"],
    )


def correlation(first: Array, second: Array) -> float | None:
    """Pearson's, of two signals; None if one of them stands still."""
    if len(first) < 3 or min(first.std(), second.std()) < 1e-6:
        return None
    return rounded(float(np.corrcoef(first, second)[0, 1]), 3)


def _tracked_points(source: str, max_frames: int | None) -> Iterator[Array]:
    tracker = open_landmark_tracker()
    nothing = np.full((LANDMARK_COUNT, 2), np.nan)
    with open_source(source, square_pixels=True) as capture:
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
