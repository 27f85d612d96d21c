"""The parameters of a face in one frame, and the table of their units and ranges."""

from dataclasses import dataclass, field, replace

import numpy as np

from shared_model.arrays import Array


@dataclass(frozen=True, slots=True)
class Eau:
    """One Expression Action Unit (thesis 2.3.1): its name, range and the AUs it realises.

    region: of the face, under which pages show it: Brows, Eyes, Nose or Mouth.
    """

    name: str
    low: float
    high: float
    au: str
    region: str


EAUS = (
    Eau("jaw_drop", 0.0, 1.0, "AU26", "Mouth"),
    Eau("mouth_corners", -1.0, 1.0, "AU12 / AU15", "Mouth"),
    Eau("eyebrow_middle", -1.0, 1.0, "AU2 / AU4", "Brows"),
    Eau("eyebrow_inner", -1.0, 1.0, "AU1 / AU4", "Brows"),
    Eau("eyebrow_outer", -1.0, 1.0, "AU2", "Brows"),
    Eau("nose_base", 0.0, 1.0, "AU9", "Nose"),
    Eau("lid_left", -0.5, 1.0, "AU45 / AU5", "Eyes"),
    Eau("lid_right", -0.5, 1.0, "AU45 / AU5", "Eyes"),
    Eau("gaze_horizontal", -1.0, 1.0, "AU61 / AU62", "Eyes"),
    Eau("gaze_vertical", -1.0, 1.0, "AU63 / AU64", "Eyes"),
    Eau("lip_stretch", -1.0, 1.0, "AU20 / AU18", "Mouth"),
    Eau("upper_lip_raise", 0.0, 1.0, "AU10", "Mouth"),
    Eau("lower_lip_lower", -0.6, 1.0, "AU16 / AU17", "Mouth"),
    Eau("lip_press", 0.0, 1.0, "AU24", "Mouth"),
)
EAU_INDEX = {eau.name: index for index, eau in enumerate(EAUS)}
EAU_LOW = tuple(eau.low for eau in EAUS)
EAU_HIGH = tuple(eau.high for eau in EAUS)
_LOW, _HIGH = np.array(EAU_LOW), np.array(EAU_HIGH)

# Thesis 4.4: the four actuators that the tracker of the thesis estimates.
THESIS_EAUS = ("jaw_drop", "mouth_corners", "eyebrow_middle", "eyebrow_inner")
LID_EAUS = ("lid_left", "lid_right")
# A list: it indexes arrays.
LIDS = [EAU_INDEX[name] for name in LID_EAUS]
BROW_EAUS = ("eyebrow_middle", "eyebrow_inner", "eyebrow_outer")

# Thesis 2.3.2, in its order: displacements in one dimension, +-1 is +-2 standard deviations.
AAUS = (
    "cranial_width",
    "facial_height",
    "facial_depth",
    "mandible_width",
    "chin_height",
    "nose_height",
    "nose_bridge_length",
    "nose_width",
    "mouth_shift",
    "mouth_width",
    "eyebrow_height",
)


@dataclass(frozen=True, slots=True)
class Pose:
    """Rigid motion `camera_from_head` (eq. 2.12): rotate by `rotation`, then add `translation_mm`.

    rotation: (4,) float64 unit quaternion (w, x, y, z), taking head axes to camera axes.
    translation_mm: (3,) float64, mm, camera frame: where the head's origin is.
    """

    rotation: Array
    translation_mm: Array


@dataclass(frozen=True, slots=True)
class FaceParameters:
    """The face in one frame.

    pose: of the head relative to the camera.
    eau: (len(EAUS),) float64, each within its `Eau` range.
    modes: (k,) float64, coefficients of the caller's appearance modes (eq. 2.17); may be empty.
    layers: (l,) float64, coefficients of the layers around the face, see
        `shared_model.layers.layer_motion`; may be empty.
    """

    pose: Pose
    eau: Array = field(default_factory=lambda: np.zeros(len(EAUS)))
    modes: Array = field(default_factory=lambda: np.zeros(0))
    layers: Array = field(default_factory=lambda: np.zeros(0))


def clip_eau(eau: Array) -> Array:
    """Clip actuators to their ranges.  eau: (..., len(EAUS)) float64."""
    return np.asarray(np.minimum(np.maximum(eau, _LOW), _HIGH))


def with_focal_change(face: FaceParameters, ratio: float) -> FaceParameters:
    """The face at the depth that keeps its size when the focal length changes by factor `ratio`."""
    x, y, z = face.pose.translation_mm
    return replace(face, pose=Pose(face.pose.rotation, np.array([x, y, z * ratio])))
