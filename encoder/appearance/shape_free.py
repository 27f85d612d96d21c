"""The shape-free frame of one caller: where each texel of the face lies, and how it moves.

Analysis by synthesis (thesis 2.4.3) compares pictures here: the same texel is the same piece of
skin in every frame, whatever the pose and expression.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.runtime.jit import compiled
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
        self._spans = spans(np.abs(fields).max(1) > 0)

    def __len__(self) -> int:
        return len(self.on_face)

    def placed(self, face: FaceParameters) -> "Placed":
        """Where the texels are in this pose and expression."""
        drive = np.concatenate([np.maximum(face.eau, 0), np.minimum(face.eau, 0)])
        rotation = geometry.matrix_from_quaternion(face.pose.rotation).astype(np.float32)
        moved_to = _driven(self._neutral, self._fields, self._spans, drive.astype(np.float32))
        turned, seen, per_mm, pixels = _projected(
            moved_to,
            rotation,
            face.pose.translation_mm.astype(np.float32),
            np.float32(self.camera.focal_px),
            self.camera.centre.astype(np.float32),
        )
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

        slope: (2, k) the picture's gradient there, per pixel.  active: (a,) actuators that move.
        Texels beside the face count as still: what they show moves in its own way.
        """
        rigid = rigid_change(placed.turned, placed.seen, placed.per_mm, slope * self.on_face)
        place = active + np.where(placed.face.eau[active] >= 0, 0, len(EAUS))
        back = placed.rotation.T @ rigid[3:]
        return np.concatenate([rigid, _along(self._fields, self._spans, place, back)])


@compiled
def _driven(neutral: Single, fields: Single, spans: NDArray[np.intp], drive: Single) -> Single:
    """(3, k) places `neutral`, moved by so much of each of the fields (n, 3, k)."""
    found = neutral.copy()
    for number in range(len(drive)):
        if drive[number]:
            first, end = spans[number]
            for axis in range(3):
                # Parts of rows, since a loop from 0 on is one that runs many texels at once.
                row, field = found[axis, first:end], fields[number, axis, first:end]
                for k in range(len(row)):
                    row[k] += drive[number] * field[k]
    return found


@compiled
def _projected(
    places: Single, rotation: Single, at_mm: Single, focal_px: np.float32, centre: Single
) -> tuple[Single, Single, Single, Single]:
    """See `Placed`, of places (3, k), head frame; pixels (2, k)."""
    count = places.shape[1]
    turned, seen = np.empty_like(places), np.empty_like(places)
    per_mm, pixels = np.empty(count, np.float32), np.empty((2, count), np.float32)
    for axis in range(3):
        for k in range(count):
            turned[axis, k] = (
                rotation[axis, 0] * places[0, k]
                + rotation[axis, 1] * places[1, k]
                + rotation[axis, 2] * places[2, k]
            )
            seen[axis, k] = turned[axis, k] + at_mm[axis]
    for k in range(count):
        per_mm[k] = focal_px / seen[2, k]
        pixels[0, k] = seen[0, k] * per_mm[k] + centre[0]
        pixels[1, k] = seen[1, k] * per_mm[k] + centre[1]
    return turned, seen, per_mm, pixels


@compiled
def _along(
    fields: Single, spans: NDArray[np.intp], chosen: NDArray[np.intp], back: Single
) -> Single:
    """(a, k) inner products of the `chosen` fields with `back` (3, k)."""
    found = np.zeros((len(chosen), back.shape[1]), np.float32)
    for number in range(len(chosen)):
        first, end = spans[chosen[number]]
        row = found[number, first:end]
        for axis in range(3):
            field, way = fields[chosen[number], axis, first:end], back[axis, first:end]
            for k in range(len(row)):
                row[k] += field[k] * way[k]
    return found


def spans(used: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(n, 2) first and end of what each row (n, k) uses."""
    first = used.argmax(1)
    end = used.shape[1] - used[:, ::-1].argmax(1)
    return np.stack([first, np.where(used.any(1), end, first)], 1)


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


@compiled
def spacing(grid: Single, places: NDArray[np.intp]) -> Single:
    """(4, n) across x and y, down x and y: how positions change from texel to texel.

    grid: (2, size, size) positions, see `whole`.  places: (n,) of texels, row by row.
    """
    size = grid.shape[1]
    found = np.empty((4, len(places)), np.float32)
    for number in range(len(places)):
        row, column = divmod(places[number], size)
        left, right = max(column - 1, 0), min(column + 1, size - 1)
        above, below = max(row - 1, 0), min(row + 1, size - 1)
        for axis in range(2):
            across = grid[axis, row, right] - grid[axis, row, left]
            down = grid[axis, below, column] - grid[axis, above, column]
            found[axis, number] = across / np.float32(right - left)
            found[2 + axis, number] = down / np.float32(below - above)
    return found


@compiled
def rigid_change(turned: Single, seen: Single, per_mm: Single, slope: Single) -> Single:
    """(6, k) how a picture changes under points that move, per radian and mm.

    turned, seen: (3, k) points, camera axes, before and after the head's translation.
    per_mm: (k,) pixels.  slope: (2, k) the picture's gradient, per pixel.
    """
    found = np.empty((6, len(per_mm)), np.float32)
    for k in range(len(per_mm)):
        u, v = slope[0, k] * per_mm[k], slope[1, k] * per_mm[k]
        w = -(u * seen[0, k] + v * seen[1, k]) / seen[2, k]
        found[0, k] = turned[1, k] * w - turned[2, k] * v
        found[1, k] = turned[2, k] * u - turned[0, k] * w
        found[2, k] = turned[0, k] * v - turned[1, k] * u
        found[3, k], found[4, k], found[5, k] = u, v, w
    return found


def moved(face: FaceParameters, step: Array) -> FaceParameters:
    """Add a step (6 + EAUs,): rotation (rad, camera axes), translation (mm), actuators."""
    turn = geometry.quaternion_from_vector(step[:3])
    rotation = geometry.normalise(geometry.multiply(turn, face.pose.rotation))
    pose = Pose(rotation, face.pose.translation_mm + step[3:6])
    return replace(face, pose=pose, eau=clip_eau(face.eau + step[6:]))
