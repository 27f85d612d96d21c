"""Annotations corrected by hand (thesis 2.4.1): landmarks put right, values held, the rest fitted.

A correction starts from the fit without a hand, so that it can be changed and taken back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from aam.annotation.annotation_file import Annotation
from aam.annotation.held_values import HeldValues
from aam.annotation.landmark_schemes import FaceLandmarks, from_known
from aam.annotation.still_fit import StillFit, fit_still
from aam.annotation.still_texture import kept_texture, kept_window
from aam.shape_space import HIGH, LOW, SHAPE_NAMES, actuators
from aam.weak_pose import POSE_COUNT, perspective_pose, telephoto
from encoder.detection.landmark_indices import LANDMARK_COUNT
from shared_model.arrays import Picture
from shared_model.geometry import Camera
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters

# How far from the picture a landmark may be put, in terms of its longer side, and the natural
# logarithm of the largest and smallest scale.
FAR, LOG_SCALE = 2.0, 10.0
WEIGHTS = (1.0, 30.0)
WEIGHT = 8.0


@dataclass(frozen=True, slots=True)
class Correction:
    """What a hand has set.

    landmarks: pixels (x, y) by the index of the landmark network.
    shape: values of the AE shape vector by their names.
    pose: (6,) of weak perspective, see `aam.weak_pose`; None: fitted.
    weight: factor by which the standard deviation of these landmarks is less than of others.
    """

    landmarks: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    shape: Mapping[str, float] = field(default_factory=dict)
    pose: tuple[float, ...] | None = None
    weight: float = WEIGHT

    @property
    def is_empty(self) -> bool:
        """Whether no hand has set anything."""
        return not self.landmarks and not self.shape and self.pose is None


def correct(annotation: Annotation, picture: Picture, correction: Correction) -> Annotation:
    """The model fitted again with what a hand has set.

    annotation: without a hand.  picture: (h, w, 3) uint8 BGR, which it is of.
    Raises `ValueError` where the landmarks tell too little, see `fit_still`.
    """
    if correction.is_empty:
        return annotation
    landmarks, size = _landmarks(annotation, correction), (picture.shape[1], picture.shape[0])
    with_residual = "residual" in annotation.options.split()
    held = _held(correction, HeldValues.of_options(annotation.options))
    fitted = fit_still(generic_head(), size, landmarks, annotation.projection, with_residual, held)
    return replace(
        annotation,
        focal_px=fitted.camera.focal_px,
        error=fitted.error,
        pose=fitted.pose,
        shape=fitted.shape,
        control_mm=fitted.control_mm,
        texture=kept_texture(picture, fitted),
        landmarks=landmarks.points,
        window=kept_window(picture, fitted),
        correction=correction_values(correction),
    )


def fit_of(annotation: Annotation, size: tuple[int, int]) -> StillFit:
    """The fit that an annotation holds.  size: (width, height) of its picture."""
    if annotation.projection == "weak":
        camera, pose = telephoto(annotation.pose, size)
    else:
        camera = Camera(*size, annotation.focal_px)
        pose = perspective_pose(annotation.pose, camera)
    aau, eau = actuators(annotation.shape)
    face = FaceParameters(pose, eau)
    control = annotation.control_mm
    return StillFit(annotation.projection, camera, face, aau, control, annotation.error)


def correction_values(correction: Correction) -> dict[str, Any]:
    """The correction as values for JSON; none if it is empty."""
    if correction.is_empty:
        return {}
    return {
        "landmarks": {str(index): list(at) for index, at in correction.landmarks.items()},
        "shape": dict(correction.shape),
        "pose": None if correction.pose is None else list(correction.pose),
        "weight": correction.weight,
    }


def correction_from(values: Mapping[str, Any], size: tuple[int, int]) -> Correction:
    """The correction of such values.  size: (width, height) of the picture.

    Raises `ValueError` if they are of another form, or out of range.
    """
    try:
        landmarks = {int(i): _place(at, size) for i, at in values.get("landmarks", {}).items()}
        shape = {str(name): _value(name, value) for name, value in values.get("shape", {}).items()}
        pose = None if values.get("pose") is None else _pose(values["pose"], size)
        weight = float(values.get("weight", WEIGHT))
    except (AttributeError, TypeError) as error:
        raise ValueError(f"this is no correction: {error}") from error
    if not all(0 <= index < LANDMARK_COUNT for index in landmarks):
        raise ValueError(f"a landmark's number is from 0 to {LANDMARK_COUNT - 1}")
    if not WEIGHTS[0] <= weight <= WEIGHTS[1]:
        raise ValueError(f"weight is {weight:g}, expected {WEIGHTS[0]:g} to {WEIGHTS[1]:g}")
    return Correction(landmarks, shape, pose, weight)


def _landmarks(annotation: Annotation, correction: Correction) -> FaceLandmarks:
    known = from_known(annotation.landmarks)
    points, sigma = known.points.copy(), known.sigma.copy()
    for index, at in correction.landmarks.items():
        points[index, :2] = at
        sigma[index] = 1 / correction.weight
    return FaceLandmarks(points, sigma)


def _held(correction: Correction, always: HeldValues) -> HeldValues:
    """What is not fitted.  always: without a hand."""
    shape = always.shape.copy()
    for name, value in correction.shape.items():
        shape[SHAPE_NAMES.index(name)] = value
    return HeldValues(shape, None if correction.pose is None else np.array(correction.pose))


def _place(at: Any, size: tuple[int, int]) -> tuple[float, float]:
    x, y = (float(value) for value in at)
    if not (abs(x) <= FAR * max(size) and abs(y) <= FAR * max(size)):
        raise ValueError(f"a landmark is at {x:g}, {y:g}, far from the picture")
    return x, y


def _value(name: Any, value: Any) -> float:
    if name not in SHAPE_NAMES:
        raise ValueError(f"nothing is called {name!r}")
    low, high = (float(limits[SHAPE_NAMES.index(name)]) for limits in (LOW, HIGH))
    if not low <= float(value) <= high:
        raise ValueError(f"{name} is {value!r}, expected a number from {low:g} to {high:g}")
    return float(value)


def _pose(values: Any, size: tuple[int, int]) -> tuple[float, ...]:
    pose = tuple(float(value) for value in values)
    limits = (*[2 * np.pi] * 3, *[FAR * max(size)] * 2, LOG_SCALE)
    if len(pose) != POSE_COUNT or not all(abs(v) <= m for v, m in zip(pose, limits, strict=True)):
        raise ValueError(f"pose is {values!r}, expected {POSE_COUNT} numbers within their limits")
    return pose
