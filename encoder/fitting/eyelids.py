"""Closure of the eyelids, from the aperture between their margins.

A least-squares fit of all landmarks explains a blink partly by the brows, the skin around the eyes
and the gaze, and leaves the lids half open.
"""

from dataclasses import replace

import numpy as np

from encoder.fitting.landmark_fit import LandmarkModel, fit_landmarks, initial_parameters
from shared_model.aperture_sheets import EYES
from shared_model.arrays import Array
from shared_model.geometry import Camera, camera_from_head, pixel_from_camera
from shared_model.parameters import EAU_INDEX, EAU_LOW, EAUS, LIDS, FaceParameters, clip_eau

GAZE_EAUS = [EAU_INDEX[name] for name in ("gaze_horizontal", "gaze_vertical")]
NON_GAZE_EAUS = [index for index in range(len(EAUS)) if index not in GAZE_EAUS]
# Aperture of closed eyes, of that at rest: the iris network keeps the margins apart.
CLOSED_APERTURE = 0.2
# The lids' actuator at rest, and as far open as it goes.
REST, WIDE_OPEN = 0.0, EAU_LOW[LIDS[0]]
# (eyes, 2, n) landmarks of the lower and the upper margin of each eye, between its corners.
MARGINS = np.array([(sheet.lower[1:-1], sheet.upper[1:-1]) for sheet in EYES])


def fit_with_eyelids(
    model: LandmarkModel, camera: Camera, points_px: Array, start: FaceParameters | None = None
) -> FaceParameters:
    """Pose and actuators of one frame from `fit_landmarks`, the lids from their aperture.

    start: its layers stay as they are; None: no face is known, see `initial_parameters`.
    The gaze is fixed straight ahead: landmarks show it by the lids alone.
    """
    start = start or initial_parameters(model, camera, points_px)
    eau = start.eau.copy()
    eau[GAZE_EAUS] = 0
    face = fit_landmarks(model, camera, points_px, replace(start, eau=eau), NON_GAZE_EAUS)
    return with_measured_eyelids(model, camera, points_px, face)


def with_measured_eyelids(
    model: LandmarkModel, camera: Camera, points_px: Array, face: FaceParameters
) -> FaceParameters:
    """The face with its lids as far open as the landmarks (468, >= 2), pixels, show them.

    model: personalised.
    """
    at_rest, wide_open = (
        _projected_margins(model, camera, _with_closure(face, closure))
        for closure in (REST, WIDE_OPEN)
    )
    seen, eau = points_px[MARGINS, :2], face.eau.copy()
    for number, lid in enumerate(LIDS):
        rest_aperture, open_aperture, aperture = (
            np.asarray((margins[number, 0] - margins[number, 1]).mean(0))
            for margins in (at_rest, wide_open, seen)
        )
        direction = rest_aperture / max(float(rest_aperture @ rest_aperture), 1e-9)
        eau[lid] = _closure(float(aperture @ direction), float(open_aperture @ direction))
    return replace(face, eau=clip_eau(eau))


def with_averaged_eyelids(measured: FaceParameters, fitted: FaceParameters) -> FaceParameters:
    """The fitted face with its lids half way to their measurement.

    The errors of both are independent: margins are noisy where eyes are small, and a texture that
    has never seen the lids closed tells nothing of closed lids.
    """
    eau = fitted.eau.copy()
    eau[LIDS] = (measured.eau[LIDS] + eau[LIDS]) / 2
    return replace(fitted, eau=eau)


def _closure(aperture: float, widest: float) -> float:
    """The lid's actuator for an aperture; both relative to rest, `widest` that of `WIDE_OPEN`."""
    if aperture < 1:
        return (1 - aperture) / (1 - CLOSED_APERTURE)
    return WIDE_OPEN * (aperture - 1) / max(widest - 1, 1e-3)


def _with_closure(face: FaceParameters, closure: float) -> FaceParameters:
    eau = face.eau.copy()
    eau[LIDS] = closure
    return replace(face, eau=eau)


def _projected_margins(model: LandmarkModel, camera: Camera, face: FaceParameters) -> Array:
    """(eyes, 2, n, 2) pixels of the model's `MARGINS`."""
    rows = np.searchsorted(model.index, MARGINS.ravel())
    displacement = np.where(face.eau[:, None, None] >= 0, model.eau_up[:, rows], 0.0)
    displacement -= np.where(face.eau[:, None, None] < 0, model.eau_down[:, rows], 0.0)
    points = model.neutral[rows] + np.tensordot(face.eau, displacement, 1)
    pixels = pixel_from_camera(camera, camera_from_head(face.pose, points))
    return pixels.reshape(*MARGINS.shape, 2)
