"""Landmark fits of all frames of a recorded sequence."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from encoder.detection.landmark_indices import OUTER_EYE_CORNERS
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import fit_identity
from encoder.fitting.landmark_fit import (
    fit_landmarks,
    initial_parameters,
    landmark_model,
    personalise,
)
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]

IDENTITY_FRAMES = 10
# Landmarks are smoothed over time with this kernel before the first fit.
SMOOTHING = np.array([0.06, 0.24, 0.4, 0.24, 0.06])


def fit_sequence(
    head: Head, size: tuple[int, int], points: Sequence[Array], initial: IdentityFit | None = None
) -> tuple[IdentityFit, list[FaceParameters]]:
    """One identity, and pose and actuators of every frame, from its landmarks (468, 3).

    near: see `fit_identity`.
    """
    chosen = pick_diverse_frames(np.array(points))
    fitted = fit_identity(head, size, [points[i] for i in chosen], initial=initial)
    model = personalise(landmark_model(head), fitted.identity.aau, fitted.control_mm)
    current = initial_parameters(model, fitted.camera, points[0])
    faces = []
    for place in points:
        current = fit_landmarks(model, fitted.camera, place, current)
        faces.append(current)
    return fitted, faces


def smooth_landmarks(points: Array) -> Array:
    """Landmarks (t, 468, 3) low-passed over time; the ends as they are mirrored."""
    reach = len(SMOOTHING) // 2
    if len(points) <= reach:
        return points
    padded = np.pad(points, ((reach, reach), (0, 0), (0, 0)), mode="reflect")
    return np.asarray(sum(w * padded[i : i + len(points)] for i, w in enumerate(SMOOTHING)))


def pick_diverse_frames(points: Array) -> list[int]:
    """Indices of up to `IDENTITY_FRAMES` frames, spread over yaw and pitch."""
    eyes = points[:, list(OUTER_EYE_CORNERS)].mean(1)
    turn = points[:, 1, :2] - eyes[:, :2]
    shares = np.linspace(0.02, 0.98, IDENTITY_FRAMES // 2)
    picks = [np.argsort(turn[:, axis])[(shares * (len(points) - 1)).astype(int)] for axis in (0, 1)]
    return sorted(set(np.concatenate(picks).tolist()))
