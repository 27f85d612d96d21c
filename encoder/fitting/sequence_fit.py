"""Landmark fits of all frames of a recorded sequence."""

from collections.abc import Sequence

import numpy as np

from encoder.detection.landmark_indices import OUTER_EYE_CORNERS
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import fit_identity
from encoder.fitting.landmark_fit import (
    fit_landmarks,
    initial_parameters,
    landmark_model,
    personalise,
)
from shared_model.arrays import Array
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

IDENTITY_FRAMES = 10
# Low-pass filter of landmarks over time, which precedes their fit.
SMOOTHING_KERNEL = np.array([0.06, 0.24, 0.4, 0.24, 0.06])


def fit_sequence(
    head: Head,
    size: tuple[int, int],
    landmarks: Sequence[Array],
    initial: IdentityFit | None = None,
    workers: int | None = 1,
) -> tuple[IdentityFit, list[FaceParameters]]:
    """One identity, and pose and actuators of every frame.

    size: (width, height) of the picture.  landmarks: (468, 3) of each frame, pixels.
    initial, workers: see `fit_identity`.
    """
    chosen = pick_diverse_frames(np.array(landmarks))
    fitted = fit_identity(head, size, [landmarks[i] for i in chosen], None, initial, workers)
    return fitted, fit_faces(head, fitted, landmarks)


def fit_faces(head: Head, fitted: IdentityFit, landmarks: Sequence[Array]) -> list[FaceParameters]:
    """Pose and actuators of every frame of a known identity.

    landmarks: (468, 3) of each frame, pixels.
    """
    model = personalise(landmark_model(head), fitted.identity.aau, fitted.control_mm)
    face = initial_parameters(model, fitted.camera, landmarks[0])
    faces = []
    for points_px in landmarks:
        face = fit_landmarks(model, fitted.camera, points_px, face)
        faces.append(face)
    return faces


def smooth_landmarks(points: Array) -> Array:
    """Landmarks (t, 468, 3) low-pass filtered over time, mirrored at both ends."""
    half = len(SMOOTHING_KERNEL) // 2
    if len(points) <= half:
        return points
    padded = np.pad(points, ((half, half), (0, 0), (0, 0)), mode="reflect")
    return np.asarray(
        sum(weight * padded[i : i + len(points)] for i, weight in enumerate(SMOOTHING_KERNEL))
    )


def pick_diverse_frames(points: Array) -> list[int]:
    """Indices of up to `IDENTITY_FRAMES` frames at different yaw and pitch.

    points: (t, 468, 3) landmarks, pixels.
    """
    eyes = points[:, list(OUTER_EYE_CORNERS)].mean(1)
    nose_offset = points[:, 1, :2] - eyes[:, :2]
    quantiles = np.linspace(0.02, 0.98, IDENTITY_FRAMES // 2)
    ranks = (quantiles * (len(points) - 1)).astype(int)
    picks = [np.argsort(nose_offset[:, axis])[ranks] for axis in (0, 1)]
    return sorted(set(np.concatenate(picks).tolist()))
