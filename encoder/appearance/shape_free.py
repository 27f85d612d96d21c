"""The shape-free frame (thesis 2.4.2): the projection and motion of the texels of one face.

Analysis by synthesis (thesis 2.4.3) compares pictures in this frame: a texel is the same piece of
skin in every picture, whatever the pose and expression.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

from runtime.jit import jit
from shared_model import geometry
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.arrays import Indices, Mask, Single, VertexIndices
from shared_model.geometry import Camera
from shared_model.mesh import PARTS
from shared_model.parameters import EAUS, FaceParameters


class ShapeFreeFrame:
    """The texels of one face as points that move with the head.

    atlas: the k texels: all of the face's atlas or a subset of them.
    flat_index: (k,) index of each texel in the whole atlas, row-major.
    on_face: (k,) bool, False on the sheet that surrounds the face.
    """

    def __init__(self, face: Face, atlas: Atlas, camera: Camera) -> None:
        self.camera, self.atlas = camera, atlas
        self.flat_index = atlas.rows.astype(np.intp) * atlas.size + atlas.columns
        head, corners, weights = face.head, atlas.corners, atlas.weights.astype(np.float32)
        self.on_face = head.parts[corners[:, 0]] != PARTS.index("surround")
        self._neutral = _at_texels(face.neutral.astype(np.float32)[None], corners, weights)[0]
        fields = np.concatenate([head.eau_up, -head.eau_down]).astype(np.float32)
        self._fields = _at_texels(fields, corners, weights)
        self._support = support_ranges((self._fields != 0).any(1))

    def __len__(self) -> int:
        return len(self.on_face)

    def subset(self, kept: Mask) -> "ShapeFreeFrame":
        """The same of the texels `kept` (k,) alone."""
        frame = copy(self)
        frame.atlas, frame.flat_index = self.atlas.subset(kept), self.flat_index[kept]
        frame.on_face = self.on_face[kept]
        frame._neutral = np.ascontiguousarray(self._neutral[:, kept])
        frame._fields = np.ascontiguousarray(self._fields[:, :, kept])
        frame._support = support_ranges((frame._fields != 0).any(1))
        return frame

    def project(self, face: FaceParameters) -> "ProjectedTexels":
        """The texels at this pose and expression, in the camera's axes and in the picture."""
        activation = np.concatenate([np.maximum(face.eau, 0), np.minimum(face.eau, 0)])
        rotation = geometry.matrix_from_quaternion(face.pose.rotation).astype(np.float32)
        projected = _project(
            _animate(self._neutral, self._fields, self._support, activation.astype(np.float32)),
            rotation,
            face.pose.translation_mm.astype(np.float32),
            np.float32(self.camera.focal_px),
            self.camera.centre.astype(np.float32),
        )
        rotated_mm, camera_mm, pixels_per_mm, pixels = projected
        return ProjectedTexels(face, rotation, rotated_mm, camera_mm, pixels_per_mm, pixels.T)

    def positions(self, face: FaceParameters) -> Single:
        """(k, 2) positions of the texels in the picture, pixels."""
        return self.project(face).pixels

    def to_grid(self, positions: Single) -> Single:
        """(2, size, size) positions (k, 2) arranged as the whole atlas, nan at unused texels."""
        grid = np.full((2, self.atlas.size**2), np.nan, np.float32)
        _scatter(grid, self.flat_index, positions)
        return grid.reshape(2, self.atlas.size, -1)

    def image_jacobian(
        self, texels: "ProjectedTexels", gradient: Single, active: Indices
    ) -> Single:
        """(6 + a, k) derivative of the picture's values at the texels by the face's parameters.

        Rows: rotation (per radian, camera axes), translation (per mm), then the actuators (a,) of
        `active` (per unit).  gradient: (2, k) the picture's gradient at the texels, per pixel.
        The derivative is 0 on the sheet that surrounds the face, where hair and background show.
        """
        rigid = rigid_jacobian(
            texels.rotated_mm, texels.camera_mm, texels.pixels_per_mm, gradient * self.on_face
        )
        fields = active + np.where(texels.face.eau[active] >= 0, 0, len(EAUS))
        gradient_head = texels.rotation.T @ rigid[3:]
        actuators = directional_jacobian(self._fields, self._support, fields, gradient_head)
        return np.concatenate([rigid, actuators])


@dataclass(frozen=True, slots=True)
class ProjectedTexels:
    """Texels at one pose and expression.

    rotation: (3, 3) of the head.
    rotated_mm, camera_mm: (3, k) camera axes, before and after the head's translation.
    pixels_per_mm: (k,) scale of the projection at each texel.  pixels: (k, 2).
    """

    face: FaceParameters
    rotation: Single
    rotated_mm: Single
    camera_mm: Single
    pixels_per_mm: Single
    pixels: Single


@jit
def _at_texels(values: Single, corners: VertexIndices, weights: Single) -> Single:
    """(n, 3, k) values (n, vertices, 3) at texels; corners, weights: (k, 3), see `Atlas`.

    Coordinates first, texels last: loops over texels then run along memory.
    """
    at_texels = np.empty((len(values), 3, len(corners)), np.float32)
    for number in range(len(values)):
        for k in range(len(corners)):
            a, b, c = corners[k]
            for axis in range(3):
                at_texels[number, axis, k] = (
                    weights[k, 0] * values[number, a, axis]
                    + weights[k, 1] * values[number, b, axis]
                    + weights[k, 2] * values[number, c, axis]
                )
    return at_texels


@jit
def _animate(neutral: Single, fields: Single, support: Indices, activation: Single) -> Single:
    """(3, k) points `neutral` displaced by the fields (n, 3, k) times their activations (n,)."""
    animated = neutral.copy()
    for number in range(len(activation)):
        if activation[number]:
            first, end = support[number]
            for axis in range(3):
                # Slices, since the compiler vectorises loops that start at 0.
                row, field = animated[axis, first:end], fields[number, axis, first:end]
                for k in range(len(row)):
                    row[k] += activation[number] * field[k]
    return animated


@jit
def _project(
    points: Single, rotation: Single, translation_mm: Single, focal_px: np.float32, centre: Single
) -> tuple[Single, Single, Single, Single]:
    """The arrays of `ProjectedTexels` for points (3, k), mm, head frame; pixels as (2, k)."""
    count = points.shape[1]
    rotated, in_camera = np.empty_like(points), np.empty_like(points)
    pixels_per_mm, pixels = np.empty(count, np.float32), np.empty((2, count), np.float32)
    for axis in range(3):
        for k in range(count):
            rotated[axis, k] = (
                rotation[axis, 0] * points[0, k]
                + rotation[axis, 1] * points[1, k]
                + rotation[axis, 2] * points[2, k]
            )
            in_camera[axis, k] = rotated[axis, k] + translation_mm[axis]
    for k in range(count):
        pixels_per_mm[k] = focal_px / in_camera[2, k]
        pixels[0, k] = in_camera[0, k] * pixels_per_mm[k] + centre[0]
        pixels[1, k] = in_camera[1, k] * pixels_per_mm[k] + centre[1]
    return rotated, in_camera, pixels_per_mm, pixels


@jit
def _scatter(grid: Single, indices: Indices, positions: Single) -> None:
    """Write positions (k, 2) to a grid (2, n) at indices (k,)."""
    for k in range(len(indices)):
        grid[0, indices[k]], grid[1, indices[k]] = positions[k, 0], positions[k, 1]


@jit
def directional_jacobian(
    fields: Single, support: Indices, chosen: Indices, gradient: Single
) -> Single:
    """(a, k) how a picture changes under points that move along fields, per unit of each field.

    fields: (n, 3, k) displacement of each point by a unit of each actuator, mm.
    support: (n, 2) first point that each field moves, and the end.  chosen: (a,) index of fields.
    gradient: (3, k) how the picture changes under each point, per mm of its motion.
    """
    products = np.zeros((len(chosen), gradient.shape[1]), np.float32)
    for number in range(len(chosen)):
        first, end = support[chosen[number]]
        row = products[number, first:end]
        for axis in range(3):
            field, slope = fields[chosen[number], axis, first:end], gradient[axis, first:end]
            for k in range(len(row)):
                row[k] += field[k] * slope[k]
    return products


def support_ranges(nonzero: Mask) -> Indices:
    """(n, 2) first index and end of the nonzero part of each row (n, k)."""
    first = nonzero.argmax(1)
    end = nonzero.shape[1] - nonzero[:, ::-1].argmax(1)
    return np.stack([first, np.where(nonzero.any(1), end, first)], 1)


@jit
def warp_jacobian(grid: Single, indices: Indices) -> Single:
    """(4, n) derivatives of texel positions: of x and y by column, then of x and y by row.

    grid: (2, size, size) positions, see `ShapeFreeFrame.to_grid`.
    indices: (n,) of texels in the whole atlas, row-major.
    """
    derivatives = np.empty((4, len(indices)), np.float32)
    for number in range(len(indices)):
        row, column = divmod(indices[number], grid.shape[1])
        ax, ay, bx, by = texel_jacobian(grid, row, column)
        derivatives[0, number], derivatives[1, number] = ax, ay
        derivatives[2, number], derivatives[3, number] = bx, by
    return derivatives


@jit
def texel_jacobian(
    grid: Single, row: int, column: int
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """What `warp_jacobian` has of one texel."""
    size = grid.shape[1]
    left, right = max(column - 1, 0), min(column + 1, size - 1)
    above, below = max(row - 1, 0), min(row + 1, size - 1)
    across, down = np.float32(right - left), np.float32(below - above)
    return (
        (grid[0, row, right] - grid[0, row, left]) / across,
        (grid[1, row, right] - grid[1, row, left]) / across,
        (grid[0, below, column] - grid[0, above, column]) / down,
        (grid[1, below, column] - grid[1, above, column]) / down,
    )


@jit
def rigid_jacobian(
    rotated_mm: Single, camera_mm: Single, pixels_per_mm: Single, gradient: Single
) -> Single:
    """(6, k) derivative of a picture's values at points by rotation (per radian) and translation
    (per mm), camera axes.

    rotated_mm, camera_mm, pixels_per_mm: see `ProjectedTexels`.
    gradient: (2, k) the picture's gradient at the points, per pixel.
    """
    jacobian = np.empty((6, len(pixels_per_mm)), np.float32)
    for k in range(len(pixels_per_mm)):
        u, v = gradient[0, k] * pixels_per_mm[k], gradient[1, k] * pixels_per_mm[k]
        w = -(u * camera_mm[0, k] + v * camera_mm[1, k]) / camera_mm[2, k]
        jacobian[0, k] = rotated_mm[1, k] * w - rotated_mm[2, k] * v
        jacobian[1, k] = rotated_mm[2, k] * u - rotated_mm[0, k] * w
        jacobian[2, k] = rotated_mm[0, k] * v - rotated_mm[1, k] * u
        jacobian[3, k], jacobian[4, k], jacobian[5, k] = u, v, w
    return jacobian
