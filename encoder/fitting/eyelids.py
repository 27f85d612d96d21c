"""How far the lids of a live caller are closed: by the gap that is seen between their margins.

A least-squares fit of all landmarks shares a blink out among the lids, a look down, the brows and
the skin around the eyes, and leaves the lids half open.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from encoder.fitting.landmark_fit import LandmarkModel, fit_landmarks, rotated_points
from shared_model.geometry import Camera, matrix_from_quaternion, pixel_from_camera
from shared_model.parameters import EAU_INDEX, EAU_LOW, EAUS, LIDS, FaceParameters, clip_eau
from shared_model.sheets import EYES, Sheet

Array = NDArray[np.float64]

GAZE_EAUS = [EAU_INDEX[name] for name in ("gaze_horizontal", "gaze_vertical")]
WITHOUT_GAZE = [index for index in range(len(EAUS)) if index not in GAZE_EAUS]
# The margins of closed lids, as the iris network sees them, stay this part of the open gap apart.
CLOSED_APERTURE = 0.2
# Where lids are at rest, and as far raised as they can be.
REST, WIDE_OPEN = 0.0, EAU_LOW[LIDS[0]]


def fit_with_eyelids(
    model: LandmarkModel, camera: Camera, points_px: Array, start: FaceParameters
) -> FaceParameters:
    """Pose and actuators of one frame as `fit_frame` finds them, but the lids as they are seen.

    The eyes look straight ahead: landmarks show a gaze by the lids alone.
    """
    eau = start.eau.copy()
    eau[GAZE_EAUS] = 0
    face = fit_landmarks(model, camera, points_px, replace(start, eau=eau), WITHOUT_GAZE)
    return with_measured_eyelids(model, camera, points_px, face)


def with_measured_eyelids(
    model: LandmarkModel, camera: Camera, points_px: Array, face: FaceParameters
) -> FaceParameters:
    """The face with its lids as far apart as the landmarks (468, >= 2), pixels, have them.

    model: of this caller.
    """
    rest, raised = (_with_lids(face, travel) for travel in (REST, WIDE_OPEN))
    drawn, widest = (_drawn(model, camera, tried) for tried in (rest, raised))
    eau = face.eau.copy()
    for lid, sheet in zip(LIDS, EYES, strict=True):
        open_gap = _gap(drawn, sheet)
        along = open_gap / max(float(open_gap @ open_gap), 1e-9)
        share, most = (float(_gap(points, sheet) @ along) for points in (points_px, widest))
        eau[lid] = _travel(share, most)
    return replace(face, eau=clip_eau(eau))


def with_averaged_eyelids(seen: FaceParameters, refined: FaceParameters) -> FaceParameters:
    """The refined face with its lids half way to where they were seen.

    Two witnesses who err apart: margins jitter where eyes are small, and texels of a caller who has
    not blinked yet know nothing of closed lids.
    """
    eau = refined.eau.copy()
    eau[LIDS] = (seen.eau[LIDS] + eau[LIDS]) / 2
    return replace(refined, eau=eau)


def _travel(share: float, most: float) -> float:
    """The lid's actuator where the gap is `share` of that at rest; `most` is that of `RAISED`."""
    if share < 1:
        return (1 - share) / (1 - CLOSED_APERTURE)
    return WIDE_OPEN * (share - 1) / max(most - 1, 1e-3)


def _with_lids(face: FaceParameters, travel: float) -> FaceParameters:
    eau = face.eau.copy()
    eau[LIDS] = travel
    return replace(face, eau=eau)


def _drawn(model: LandmarkModel, camera: Camera, face: FaceParameters) -> Array:
    """(468, 2) pixels of the model's landmarks, nan for those that it has not."""
    turned, _ = rotated_points(model, matrix_from_quaternion(face.pose.rotation), face.eau)
    places = np.full((468, 2), np.nan)
    places[model.index] = pixel_from_camera(camera, turned + face.pose.translation_mm)
    return places


def _gap(points_px: Array, sheet: Sheet) -> Array:
    """(2,) pixels from the lower to the upper margin, mean between the corners."""
    upper, lower = list(sheet.upper[1:-1]), list(sheet.lower[1:-1])
    return np.asarray((points_px[upper, :2] - points_px[lower, :2]).mean(0))
