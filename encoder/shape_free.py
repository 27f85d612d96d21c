"""The shape-free frame of one caller: where each texel of the face lies, and how it moves.

Analysis by synthesis (thesis 2.4.3) compares pictures here: the same texel is the same piece of
skin in every frame, whatever the pose and expression.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from encoder.fit import projection_jacobian
from shared_model import geometry
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.geometry import Camera
from shared_model.parameters import EAUS, FaceParameters, Pose, clip_eau

Array = NDArray[np.float64]
Single = NDArray[np.float32]


class ShapeFree:
    """One caller's texels as points on the moving head.

    atlas: its texels, all of them or a subset; k of them.
    """

    def __init__(self, face: Face, atlas: Atlas, camera: Camera) -> None:
        self.camera, self.atlas = camera, atlas
        corners, weights = atlas.corners, atlas.weights.astype(np.float32)

        def at(values: Array) -> Single:
            gathered = values.astype(np.float32)[..., corners, :]
            return np.asarray(np.einsum("kc,...kcd->...kd", weights, gathered))

        self._neutral = at(face.neutral)
        fields = np.concatenate([at(face.head.eau_up), at(-face.head.eau_down)])
        self._fields = np.ascontiguousarray(fields.reshape(len(fields), -1))

    def __len__(self) -> int:
        return len(self._neutral)

    def turned(self, face: FaceParameters) -> Single:
        """(k, 3) texels, mm, camera axes, before the head's translation."""
        drive = np.concatenate([np.maximum(face.eau, 0), np.minimum(face.eau, 0)])
        points = self._neutral + (drive.astype(np.float32) @ self._fields).reshape(-1, 3)
        rotation = geometry.matrix_from_quaternion(face.pose.rotation).astype(np.float32)
        return np.asarray(points @ rotation.T)

    def positions(self, face: FaceParameters) -> Single:
        """(k, 2) where each texel lies in the picture, pixels."""
        seen = self.turned(face) + face.pose.translation_mm.astype(np.float32)
        flat = seen[:, :2] * (np.float32(self.camera.focal_px) / seen[:, 2:])
        return np.asarray(flat + self.camera.centre.astype(np.float32))

    def motion(self, face: FaceParameters) -> Single:
        """(k, 2, 6 + EAUs) how texels move, pixels, per radian, mm and unit of each actuator."""
        turned = self.turned(face)
        seen = turned + face.pose.translation_mm.astype(np.float32)
        through = projection_jacobian(self.camera, seen).astype(np.float32)
        rotation = geometry.matrix_from_quaternion(face.pose.rotation).astype(np.float32)
        place = np.arange(len(EAUS)) + np.where(face.eau >= 0, 0, len(EAUS))
        fields = self._fields[place].reshape(len(EAUS), -1, 3)
        out = np.empty((len(self), 2, 6 + len(EAUS)), np.float32)
        x, y, z = turned.T
        a, b = through[:, :, 0], through[:, :, 1]
        c = through[:, :, 2]
        out[:, :, 0] = c * y[:, None] - b * z[:, None]
        out[:, :, 1] = a * z[:, None] - c * x[:, None]
        out[:, :, 2] = b * x[:, None] - a * y[:, None]
        out[:, :, 3:6] = through
        out[:, :, 6:] = np.einsum("kij,ekj->kie", through @ rotation, fields, optimize=True)
        return out


def moved(face: FaceParameters, step: Array) -> FaceParameters:
    """Add a step (6 + EAUs,): rotation (rad, camera axes), translation (mm), actuators."""
    turn = geometry.quaternion_from_vector(step[:3])
    rotation = geometry.normalise(geometry.multiply(turn, face.pose.rotation))
    pose = Pose(rotation, face.pose.translation_mm + step[3:6])
    return replace(face, pose=pose, eau=clip_eau(face.eau + step[6:]))
