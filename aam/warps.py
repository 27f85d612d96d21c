"""What the model needs of a shape: where its texels and landmarks are in a picture.

The 3D head is one such shape.  The 2D AAM of the validation is another, so that both are trained
and searched by the same code.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from aam.shape_space import SHAPE_RANGE, actuators
from aam.texture_frame import texture_frame
from aam.weak_pose import POSE_NAMES, displaced, rotation_matrix, step_between
from encoder.detection.landmark_indices import EYE_CORNER_PAIRS
from encoder.fitting.landmark_fit import landmark_model
from shared_model.arrays import Array, Indices, Single, VertexIndices
from shared_model.mesh import generic_head
from shared_model.shape_residual import residual_basis

# Displacements of Table 2.4: shares of the face's width and height, degrees, scales.
TRANSLATION_SHARES = (-0.1, -0.05, 0.05, 0.1)
ROTATIONS_DEG = (-15.0, -5.0, 5.0, 15.0)
SCALES = (0.9, 1.1)


class Warp(Protocol):
    """A shape (n,) at a pose (p,) in a picture; the last three values of a pose are x, y, log
    scale.

    rows, columns: (k,) of the texels in a square of `size`.  pose_names: (p,).
    width, height: of the face, in the unit of steps of x and y.
    eye_corners: which landmarks are the outer corner of the right eye, the inner one, the inner
        one of the left eye, the outer one.
    """

    @property
    def size(self) -> int: ...
    @property
    def rows(self) -> VertexIndices: ...
    @property
    def columns(self) -> VertexIndices: ...
    @property
    def pose_names(self) -> tuple[str, ...]: ...
    @property
    def width(self) -> float: ...
    @property
    def height(self) -> float: ...
    @property
    def eye_corners(self) -> tuple[int, int, int, int]: ...

    def positions(self, shape: Array, pose: Array) -> Single:
        """(2, k) x and y of the texels, pixels."""
        ...

    def landmarks(self, shape: Array, pose: Array) -> Array:
        """(m, 2) pixels."""
        ...

    def displaced(self, pose: Array, step: Array) -> Array:
        """The pose after a step (p,) in axes of the face."""
        ...

    def step_between(self, pose: Array, target: Array) -> Array:
        """The step (p,) from one pose to another."""
        ...

    def upright(self, turn: float, place: Array) -> Array:
        """The frontal pose (p,), turned clockwise in the picture, radians, at (x, y, log scale)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ResidualModes:
    """Residual shape: mean (k, 3) and modes (r, k, 3) of its control points, mm, head frame."""

    mean: Array
    modes: Array


class HeadWarp:
    """The 3D head under weak perspective; its shapes are AE shape vectors (25,), with residual
    modes (25 + r,): their coefficients follow.

    size, frame: see `texture_frame`.  landmark_index: (m,) of the network's 468 landmarks.
    residual: what is added to the head; None: nothing.
    """

    pose_names = POSE_NAMES

    def __init__(self, size: int, frame: str, residual: ResidualModes | None = None) -> None:
        head, atlas = generic_head(), texture_frame(size, frame)
        self.size, self.rows, self.columns = size, atlas.rows, atlas.columns
        weights = atlas.weights.astype(np.float32)

        def at_texels(values: Array) -> Single:
            gathered = values.astype(np.float32)[..., atlas.corners, :]
            points = np.einsum("kc,...kcd->...dk", weights, gathered)
            return np.ascontiguousarray(points.reshape(*points.shape[:-2], -1))

        self._neutral = at_texels(head.vertices)
        fields = [at_texels(head.aau), at_texels(head.eau_up), at_texels(head.eau_down)]
        self._fields = np.concatenate(fields)
        model = landmark_model(head)
        self.landmark_index = model.index
        landmark_fields = np.concatenate([model.aau, model.eau_up, model.eau_down])
        self._landmarks, self._landmark_fields = model.neutral, landmark_fields
        neutral = self._neutral.reshape(3, -1)
        self.width, self.height = (float(np.ptp(neutral[axis])) for axis in (0, 1))
        self.eye_corners = _eye_corners(model.index)
        if residual is not None:
            controls = np.concatenate([residual.mean[None], residual.modes])
            fields = np.einsum("kn,rkd->rnd", residual_basis(head), controls)
            mean, *modes = at_texels(fields)
            self._neutral = self._neutral + mean
            self._fields = np.concatenate([self._fields, np.array(modes)])
            mean, *modes = np.einsum("km,rkd->rmd", model.residual, controls)
            self._landmarks = self._landmarks + mean
            self._landmark_fields = np.concatenate([landmark_fields, np.array(modes)])

    def positions(self, shape: Array, pose: Array) -> Single:
        """See `Warp`."""
        points = self._neutral + _activation(shape).astype(np.float32) @ self._fields
        rotation = rotation_matrix(pose)[:2] * np.exp(pose[5])
        flat = rotation.astype(np.float32) @ points.reshape(3, -1)
        return np.asarray(flat + pose[3:5, None].astype(np.float32))

    def landmarks(self, shape: Array, pose: Array) -> Array:
        """(m, 2) pixels of the network's landmarks `landmark_index`."""
        rotation = rotation_matrix(pose)[:2] * np.exp(pose[5])
        return np.asarray(self._landmark_points(shape) @ rotation.T + pose[3:5])

    def landmark_depths(self, shape: Array, pose: Array) -> Array:
        """(m,) of the same, pixels, about the head's origin, growing away from the camera."""
        direction = rotation_matrix(pose)[2] * np.exp(pose[5])
        return np.asarray(self._landmark_points(shape) @ direction)

    def _landmark_points(self, shape: Array) -> Array:
        """(m, 3) mm, head frame."""
        moved = np.tensordot(_activation(shape), self._landmark_fields, 1)
        return np.asarray(self._landmarks + moved)

    def displaced(self, pose: Array, step: Array) -> Array:
        """See `aam.weak_pose`."""
        return displaced(pose, step)

    def step_between(self, pose: Array, target: Array) -> Array:
        """See `aam.weak_pose`."""
        return step_between(pose, target)

    def upright(self, turn: float, place: Array) -> Array:
        """See `Warp`."""
        # A clockwise turn in the picture is one about the head's -z.
        return np.array([0.0, 0.0, -turn, *place])


@lru_cache(maxsize=8)
def head_warp(size: int, frame: str) -> HeadWarp:
    """See `HeadWarp`; each is made once."""
    return HeadWarp(size, frame)


def pose_from_eyes(warp: Warp, shape: Array, eyes_px: Array) -> Array:
    """The frontal pose (p,) at which the eyes of a shape (n,) are at given places.

    eyes_px: (2, 2) middle between the corners of the right and of the left eye, pixels.
    """
    corners = warp.landmarks(shape, warp.upright(0.0, np.zeros(3)))[list(warp.eye_corners)]
    return pose_from_two_points(warp, corners.reshape(2, 2, 2).mean(1), eyes_px)


def pose_from_two_points(warp: Warp, model: Array, target_px: Array) -> Array:
    """The frontal pose (p,) that brings two points to given places.

    model: (2, 2) where the pose of no turn, no shift and scale 1 has them.  target_px: (2, 2).
    """
    a, b = model[1] - model[0], target_px[1] - target_px[0]
    turn = float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))
    scale = float(np.linalg.norm(b) / np.linalg.norm(a))
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    shift = target_px.mean(0) - scale * rotation @ model.mean(0)
    return warp.upright(turn, np.array([*shift, np.log(scale)]))


def pose_displacements(warp: Warp) -> list[tuple[int, list[float]]]:
    """Each parameter of the pose with its displacements (Table 2.4)."""
    found: list[tuple[int, list[float]]] = []
    for index, name in enumerate(warp.pose_names):
        if name == "tx":
            steps = [share * warp.width for share in TRANSLATION_SHARES]
        elif name == "ty":
            steps = [share * warp.height for share in TRANSLATION_SHARES]
        elif name == "scale":
            steps = [float(np.log(scale)) for scale in SCALES]
        else:
            steps = [float(np.radians(angle)) for angle in ROTATIONS_DEG]
        found.append((index, steps))
    return found


def _activation(shape: Array) -> Array:
    """(11 + 2 x 14 + r,) of the fields: AAUs, EAUs above rest, EAUs below rest, residual modes."""
    if len(shape) < len(SHAPE_RANGE):
        raise ValueError(f"shape has {len(shape)} values, expected {len(SHAPE_RANGE)} or more")
    aau, eau = actuators(shape[: len(SHAPE_RANGE)])
    rest = shape[len(SHAPE_RANGE) :]
    return np.concatenate([aau, np.maximum(eau, 0), np.maximum(-eau, 0), rest])


def _eye_corners(index: Indices) -> tuple[int, int, int, int]:
    at = {int(landmark): number for number, landmark in enumerate(index)}
    (right, inner_right), (left, inner_left) = EYE_CORNER_PAIRS
    return at[right], at[inner_right], at[inner_left], at[left]
