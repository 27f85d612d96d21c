"""The shape-free frame of one caller: where each texel of the face lies, and how it moves.

Analysis by synthesis (thesis 2.4.3) compares pictures here: the same texel is the same piece of
skin in every frame, whatever the pose and expression.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared_model import geometry
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.geometry import Camera
from shared_model.mesh import PARTS
from shared_model.parameters import EAUS, FaceParameters, Pose, clip_eau

Array = NDArray[np.float64]
Single = NDArray[np.float32]


class ShapeFree:
    """One caller's texels as points on the moving head.

    atlas: its texels, all of them or a subset; k of them.
    place: (k,) where in the whole atlas each is, row by row.
    on_face: (k,) bool, False on the sheet beside the face.
    """

    def __init__(self, face: Face, atlas: Atlas, camera: Camera) -> None:
        self.camera, self.atlas = camera, atlas
        self.place = atlas.rows.astype(np.intp) * atlas.size + atlas.columns
        corners, weights = atlas.corners, atlas.weights.astype(np.float32)

        def at(values: Array) -> Single:
            gathered = values.astype(np.float32)[..., corners, :]
            return np.asarray(np.einsum("kc,...kcd->...dk", weights, gathered))

        # By coordinates, then texels: what is done to many texels runs along memory.
        self._neutral = np.ascontiguousarray(at(face.neutral))
        self.on_face = face.head.parts[corners[:, 0]] != PARTS.index("surround")
        fields = np.concatenate([at(face.head.eau_up), at(-face.head.eau_down)])
        self._fields = np.ascontiguousarray(fields)

    def __len__(self) -> int:
        return len(self.on_face)

    def placed(self, face: FaceParameters) -> "Placed":
        """Where the texels are in this pose and expression."""
        drive = np.concatenate([np.maximum(face.eau, 0), np.minimum(face.eau, 0)])
        moved_by = drive.astype(np.float32) @ self._fields.reshape(len(drive), -1)
        rotation = geometry.matrix_from_quaternion(face.pose.rotation).astype(np.float32)
        turned = rotation @ (self._neutral + moved_by.reshape(self._neutral.shape))
        seen = turned + face.pose.translation_mm.astype(np.float32)[:, None]
        per_mm = np.float32(self.camera.focal_px) / seen[2]
        pixels = seen[:2] * per_mm + self.camera.centre.astype(np.float32)[:, None]
        return Placed(face, rotation, turned, seen, per_mm, pixels.T)

    def positions(self, face: FaceParameters) -> Single:
        """(k, 2) where each texel lies in the picture, pixels."""
        return self.placed(face).pixels

    def whole(self, positions: Single) -> Single:
        """(2, size, size) positions (k, 2) over the whole atlas, nan where there is no texel."""
        grid = np.full((2, self.atlas.size**2), np.nan, np.float32)
        for flat, values in zip(grid, positions.T, strict=True):
            flat[self.place] = values
        return grid.reshape(2, self.atlas.size, -1)

    def change(self, placed: "Placed", slope: Single, active: NDArray[np.intp]) -> Single:
        """(6 + a, k) how the picture under each texel changes, per radian, mm and unit.

        slope: (k, 2) the picture's gradient there, per pixel.  active: (a,) actuators that move.
        Texels beside the face count as still: what they show moves in its own way.
        """
        rigid = rigid_change(placed.turned, placed.seen, placed.per_mm, slope.T * self.on_face)
        place = active + np.where(placed.face.eau[active] >= 0, 0, len(EAUS))
        back = placed.rotation.T @ rigid[3:]
        driven = np.einsum("ack,ck->ak", self._fields[place], back)
        return np.concatenate([rigid, driven])


@dataclass(frozen=True, slots=True)
class Placed:
    """Texels of a face: rotation (3, 3), turned and seen (3, k) mm, camera axes, before and after
    the head's translation, per_mm (k,) pixels per mm at each, pixels (k, 2)."""

    face: FaceParameters
    rotation: Single
    turned: Single
    seen: Single
    per_mm: Single
    pixels: Single


def spacing(grid: Single) -> tuple[Single, Single]:
    """(2, size, size) positions from texel to texel, across and down, of those of `whole`."""
    across, down = (np.asarray(np.gradient(grid, axis=axis)) for axis in (2, 1))
    return across, down


def rigid_change(turned: Single, seen: Single, per_mm: Single, slope: Single) -> Single:
    """(6, k) how a picture changes under points that move, per radian and mm.

    turned, seen: (3, k) points, camera axes, before and after the head's translation.
    per_mm: (k,) pixels.  slope: (2, k) the picture's gradient, per pixel.
    """
    u, v = slope * per_mm
    x, y, z = seen
    w = -(u * x + v * y) / z
    tx, ty, tz = turned
    return np.stack([ty * w - tz * v, tz * u - tx * w, tx * v - ty * u, u, v, w])


def moved(face: FaceParameters, step: Array) -> FaceParameters:
    """Add a step (6 + EAUs,): rotation (rad, camera axes), translation (mm), actuators."""
    turn = geometry.quaternion_from_vector(step[:3])
    rotation = geometry.normalise(geometry.multiply(turn, face.pose.rotation))
    pose = Pose(rotation, face.pose.translation_mm + step[3:6])
    return replace(face, pose=pose, eau=clip_eau(face.eau + step[6:]))
