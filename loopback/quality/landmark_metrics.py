"""Landmarks of a decoded face against those of its source, and the motion of mouth, brows, lids."""

from dataclasses import dataclass

import cv2
import numpy as np

from encoder.detection.landmark_indices import LANDMARK_DISTANCES, OUTER_EYE_CORNERS
from loopback.report import rounded
from shared_model.arrays import Array, Mask

# Landmarks whose places give the pose of a head: nose, chin, eye and mouth corners, forehead, jaw.
POSE_LANDMARKS = [1, 152, 33, 263, 61, 291, 168, 199]
# Fewer frames say nothing of a pose or of restlessness.
LEAST_FRAMES = 4
# Lids move where the eyes' opening changes by this share of its median from a frame to the next,
# and are closed where it is below the other share.
LID_MOTION, CLOSED_LIDS = 0.15, 0.5


@dataclass(frozen=True, slots=True)
class LandmarkMetrics:
    """Agreement of two videos of a face; a figure is None if it cannot be measured.

    face_found: share of the frames with a face whose copy has one as well.
    nme_percent: mean distance between the landmarks of both, percent of the eyes' distance.
    *_corr: correlation over time of the mouth's opening, the brows' height and the eyes' opening.
    mouth_mae_percent: mean difference of the mouth's opening, percent of the eyes' distance.
    *_mae_deg: mean difference of the head's pose.
    jitter_ratio: restlessness of the decoded landmarks over that of the source's, see
        `restlessness`; 1 is as calm as the source.
    """

    face_found: float | None = None
    nme_percent: float | None = None
    mouth_corr: float | None = None
    brow_corr: float | None = None
    blink_corr: float | None = None
    mouth_mae_percent: float | None = None
    pitch_mae_deg: float | None = None
    yaw_mae_deg: float | None = None
    roll_mae_deg: float | None = None
    jitter_ratio: float | None = None


def landmark_metrics(
    source: Array, decoded: Array, size: tuple[int, int] = (0, 0)
) -> LandmarkMetrics:
    """Compare landmarks (t, 468, 2 or 3) of two videos, pixels; nan: no face.

    size: (width, height) of the pictures.  Poses need it, and the depths.
    """
    in_source, in_decoded = (np.isfinite(points[:, 0, 0]) for points in (source, decoded))
    both = in_source & in_decoded
    if not both.any():
        return LandmarkMetrics(face_found=0.0 if in_source.any() else None)
    a, b = source[both], decoded[both]
    flat_a, flat_b = a[..., :2], b[..., :2]
    distance = np.linalg.norm(flat_a - flat_b, axis=2).mean(1) / _eye_distance(flat_a)
    gaps = {
        name: (_landmark_distance(flat_a, name), _landmark_distance(flat_b, name))
        for name in LANDMARK_DISTANCES
    }
    pitch, yaw, roll = _pose_errors_deg(a, b, size)
    return LandmarkMetrics(
        face_found=rounded(float(in_decoded[in_source].mean()), 3),
        nme_percent=rounded(100 * float(distance.mean())),
        mouth_corr=correlation(*gaps["mouth"]),
        brow_corr=correlation(*gaps["brow"]),
        blink_corr=correlation(*gaps["blink"]),
        mouth_mae_percent=rounded(100 * float(np.abs(np.subtract(*gaps["mouth"])).mean())),
        pitch_mae_deg=pitch,
        yaw_mae_deg=yaw,
        roll_mae_deg=roll,
        jitter_ratio=_jitter_ratio(flat_a, flat_b),
    )


def correlation(first: Array, second: Array) -> float | None:
    """Pearson's, of two signals; None if one of them stands still."""
    if len(first) < 3 or min(first.std(), second.std()) < 1e-6:
        return None
    return rounded(float(np.corrcoef(first, second)[0, 1]), 3)


def frames_of_blinks(points: Array) -> Mask:
    """(t,) bool: frames in which lids move or are closed, of landmarks (t, 468, 2 or 3)."""
    opening = _landmark_distance(points[..., :2], "blink")
    if not np.isfinite(opening).any():
        return np.zeros(len(points), np.bool_)
    usual = float(np.nanmedian(opening))
    is_changed = np.abs(np.diff(opening)) > LID_MOTION * usual
    moves = np.append(is_changed, False) | np.append(False, is_changed)
    return np.asarray(moves | (opening < CLOSED_LIDS * usual))


def restlessness(points: Array) -> float:
    """Root mean square of the second differences over time of landmarks (t, 468, 2), in the eyes'
    distance."""
    second = np.diff(points, n=2, axis=0) / _eye_distance(points).mean()
    return float(np.sqrt(np.mean(second**2)))


def _jitter_ratio(source: Array, decoded: Array) -> float | None:
    if len(source) < LEAST_FRAMES:
        return None
    return rounded(restlessness(decoded) / max(restlessness(source), 1e-9))


def _pose_errors_deg(
    source: Array, decoded: Array, size: tuple[int, int]
) -> tuple[float | None, float | None, float | None]:
    """Mean differences of pitch, yaw and roll, by the shape of the most frontal face."""
    if len(source) < LEAST_FRAMES or source.shape[2] < 3 or not any(size):
        return None, None, None
    left, right = OUTER_EYE_CORNERS
    frontal = source[np.argmin(np.abs(source[:, left, 2] - source[:, right, 2]))]
    shape = frontal[POSE_LANDMARKS]
    shape = (shape - shape.mean(0)) / np.linalg.norm(frontal[left, :2] - frontal[right, :2])
    poses = [
        np.array([_pose_deg(each, shape, size) for each in some]) for some in (source, decoded)
    ]
    apart = np.abs((poses[0] - poses[1] + 180) % 360 - 180)
    pitch, yaw, roll = (rounded(float(np.nanmean(apart[:, axis]))) for axis in range(3))
    return pitch, yaw, roll


def _pose_deg(points: Array, shape: Array, size: tuple[int, int]) -> Array:
    """(3,) pitch, yaw and roll of landmarks (468, >= 2) against a shape (8, 3); nan: unknown."""
    focal = float(max(size))
    camera = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    places = np.ascontiguousarray(points[POSE_LANDMARKS, :2])
    done, rotation, _ = cv2.solvePnP(shape, places, camera, None, flags=cv2.SOLVEPNP_SQPNP)
    if not done:
        return np.full(3, np.nan)
    return np.array(cv2.RQDecomp3x3(cv2.Rodrigues(rotation)[0])[0])


def _eye_distance(points: Array) -> Array:
    left, right = (points[:, corner] for corner in OUTER_EYE_CORNERS)
    return np.asarray(np.linalg.norm(left - right, axis=1))


def _landmark_distance(points: Array, name: str) -> Array:
    """(t,) how far the gesture is open, in the eyes' distance."""
    gaps = [
        np.linalg.norm(points[:, a] - points[:, b], axis=1) for a, b in LANDMARK_DISTANCES[name]
    ]
    return np.asarray(np.mean(gaps, axis=0) / _eye_distance(points))
