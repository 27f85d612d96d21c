"""How the layer of the person moves with the head: the warp of a mesh, as plain arrays.

Each mesh point is lifted to the depth plane of the head's origin in the reference frame, moved
rigidly with the head, and projected again.  Near the outline of the head it follows completely
(hair and ears belong to the head); over about a face width the motion falls off.  Below the chin a
point follows the translation of the head but not its rotation, since the neck does not rotate.

Close to the skin in the background picture, the mesh also follows the motion of the skin relative
to that plane: parts nearer to the camera move farther when the head turns, and the jaw opens.  So
the chin and the hairline in the picture stay under the drawn ones and no second outline appears.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from shared_model.arrays import Array, Indices
from shared_model.geometry import (
    Camera,
    camera_from_head,
    conjugate,
    matrix_from_quaternion,
    multiply,
    pixel_from_camera,
    pixel_from_head,
)
from shared_model.mesh import PARTS, Head
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

# Cells of the mesh in a face width; at most so many along the longer side of the picture.
CELLS_PER_FACE = 10
MAX_CELLS = 64
# In face widths: hair beyond the outline of the head, falloff of the motion, length of the neck,
# and standard deviation of the kernel by which the skin moves mesh points.
HAIR_MARGIN = 0.15
FALLOFF_WIDTH = 0.8
NECK_LENGTH = 0.6
SKIN_SIGMA = 0.08
# Weight of no motion, against about 1 on the skin.
FREE_WEIGHT = 0.15
MIN_WEIGHT = 1e-3
FACING_COSINE = 0.3
# Greatest change of the motion over a unit of length; at 1 the mesh would fold.
MAX_STRAIN = 0.55
# Smallest area of a warped cell, relative to its own.
MIN_AREA = 0.05


@dataclass(frozen=True, slots=True)
class SkinConstraints:
    """The skin in the background picture and the mesh points that move with it.

    vertices: (k,) int, vertices of the head.
    rigid_mm: (k, 3) float64, camera frame: these in the plane of the mesh.
    points: (p,) int, mesh points, row by row.
    rbf_weights: (p, k) float64, weight of each vertex in the motion of each point; rows sum
        to at most 1.
    """

    vertices: Indices
    rigid_mm: Array
    points: Indices
    rbf_weights: Array


@dataclass(frozen=True, slots=True)
class BackgroundMesh:
    """The mesh of the background picture and the weights of the head's motion in it.

    camera, reference: camera and head pose of the picture.
    face_width_px: width of the face in the picture.
    grid_px: (rows, columns, 2) float64, pixels, the unwarped mesh, as large as the picture.
    rigid_mm: (rows, columns, 3) float64, camera frame, mm: the points at the depth of the head.
    distance_px: (rows, columns) float64, pixels, from the head and its hair; 0 inside.
    rotation_weight: (rows, columns) float64 in [0, 1]: weight of the head's rotation.
    """

    camera: Camera
    reference: Pose
    face_width_px: float
    grid_px: Array
    rigid_mm: Array
    distance_px: Array
    rotation_weight: Array
    skin: SkinConstraints


def make_background_mesh(
    camera: Camera, reference: Pose, head: Head, vertices: Array
) -> BackgroundMesh:
    """The mesh of a background picture in which `head` has the pose `reference`.

    vertices: (n, 3) float64, mm, head frame: the head in the picture.
    """
    solid = head.parts != PARTS.index("surround")
    outline_px = pixel_from_head(camera, reference, vertices[solid])
    face_width_px = projected_face_width_px(camera, reference, head, vertices)
    grid_px = _grid(camera, face_width_px)
    nearest_px2 = _squared_distances(grid_px.reshape(-1, 2), outline_px).min(axis=1)
    nearest_px = np.sqrt(nearest_px2).reshape(grid_px.shape[:2])
    return BackgroundMesh(
        camera=camera,
        reference=reference,
        face_width_px=face_width_px,
        grid_px=grid_px,
        rigid_mm=_lift(camera, reference, grid_px),
        distance_px=np.maximum(nearest_px - HAIR_MARGIN * face_width_px, 0),
        rotation_weight=_rotation_weight(
            camera, reference, grid_px, vertices[solid], face_width_px
        ),
        skin=_skin_constraints(
            camera, reference, head, vertices, grid_px, SKIN_SIGMA * face_width_px
        ),
    )


def projected_face_width_px(camera: Camera, pose: Pose, head: Head, vertices: Array) -> float:
    """Width of the face in the picture, without its surround.  vertices: (n, 3) float64, mm."""
    drawn = (head.opacity > 0) & (head.parts != PARTS.index("surround"))
    return float(np.ptp(pixel_from_head(camera, pose, vertices[drawn])[:, 0]))


def warp(
    mesh: BackgroundMesh, pose: Pose, vertices: Array, own_motion: Array | None = None
) -> Array:
    """(rows, columns, 2) the warped mesh of a frame, pixels.

    vertices: (n, 3) float64, mm, head frame: the head in that frame, which has the pose `pose`.
    own_motion: (rows, columns, 2) pixels, in addition to the motion with the head, see
        `layer_motion`.
    """
    motion = _rigid_motion(mesh, pose)
    motion = _hold_edges(mesh, motion * _motion_falloff(mesh, motion)[..., None])
    skin_motion = np.zeros_like(motion)
    skin = mesh.skin
    skin_motion.reshape(-1, 2)[skin.points] = skin.rbf_weights @ _skin_motion(mesh, pose, vertices)
    skin_motion = _hold_edges(mesh, skin_motion)
    if own_motion is not None:
        skin_motion += own_motion
    grid_px = mesh.grid_px + motion
    min_area_px2 = MIN_AREA * float(np.prod(mesh.grid_px[1, 1] - mesh.grid_px[0, 0]))
    return grid_px + max_unfolded_step(grid_px, skin_motion, min_area_px2) * skin_motion


def _grid(camera: Camera, face_width_px: float) -> Array:
    longer = max(camera.width, camera.height)
    cell_px = max(face_width_px / CELLS_PER_FACE, longer / MAX_CELLS)
    columns, rows = (int(np.ceil(side / cell_px)) + 1 for side in (camera.width, camera.height))
    u = np.linspace(-0.5, camera.width - 0.5, columns)
    v = np.linspace(-0.5, camera.height - 0.5, rows)
    return np.stack(np.meshgrid(u, v), axis=-1)


def _lift(camera: Camera, reference: Pose, points_px: Array) -> Array:
    """(..., 3) mm, camera frame: pixels (..., 2) in the depth plane of the head's origin."""
    depth_mm = np.full((*points_px.shape[:-1], 1), reference.translation_mm[2])
    plane = (points_px - camera.centre) * depth_mm / camera.focal_px
    return np.concatenate([plane, depth_mm], axis=-1)


def _rotation_weight(
    camera: Camera, reference: Pose, grid_px: Array, vertices: Array, face_width_px: float
) -> Array:
    """1 down to the chin, then falling to 0 along the neck."""
    down = -matrix_from_quaternion(reference.rotation)[:2, 1]
    # The neck of a head that looks straight up is not in the picture.
    down /= max(float(np.linalg.norm(down)), 1e-9)
    chin_px = float(np.max(pixel_from_head(camera, reference, vertices) @ down))
    below = (grid_px @ down - chin_px) / (NECK_LENGTH * face_width_px)
    return 1 - smoothstep(below)


def _skin_constraints(
    camera: Camera, reference: Pose, head: Head, vertices: Array, grid_px: Array, sigma_px: float
) -> SkinConstraints:
    drawn = (head.opacity > 0) & (head.parts == PARTS.index("skin"))
    facing = _cosines(reference, head, vertices) > FACING_COSINE
    selected = np.flatnonzero(drawn & facing)
    selected_px = pixel_from_head(camera, reference, vertices[selected])
    weights = _kernel(grid_px.reshape(-1, 2), selected_px, sigma_px)
    points = np.flatnonzero(weights.max(axis=1, initial=0) > MIN_WEIGHT)
    # By the area around each vertex, since vertices are dense around eyes and mouth.
    share = weights[points] / _kernel(selected_px, selected_px, sigma_px).sum(axis=1)
    return SkinConstraints(
        vertices=selected,
        rigid_mm=_lift(camera, reference, selected_px),
        points=points,
        rbf_weights=share / (share.sum(axis=1, keepdims=True) + FREE_WEIGHT),
    )


def _cosines(reference: Pose, head: Head, vertices: Array) -> Array:
    """(n,) cosine between each vertex' outward normal and the direction to the camera."""
    seen = camera_from_head(reference, vertices)
    towards = -seen / np.linalg.norm(seen, axis=1, keepdims=True)
    return np.asarray((vertex_normals(seen, head.triangles) * towards).sum(axis=1))


def _kernel(points: Array, centres: Array, sigma: float) -> Array:
    return np.asarray(np.exp(_squared_distances(points, centres) / (-2 * sigma**2)))


def _squared_distances(a: Array, b: Array) -> Array:
    """(p, q) of points (p, 2) and (q, 2)."""
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    return np.asarray(np.maximum(squares, 0))


def _rigid_motion(mesh: BackgroundMesh, pose: Pose) -> Array:
    """(rows, columns, 2) pixels: motion with the head, of the neck without rotation."""
    turned = _moved_with_head(mesh, pose, mesh.rigid_mm)
    shifted = mesh.rigid_mm + (pose.translation_mm - mesh.reference.translation_mm)
    target_mm = shifted + mesh.rotation_weight[..., None] * (turned - shifted)
    return pixel_from_camera(mesh.camera, target_mm) - mesh.grid_px


def _skin_motion(mesh: BackgroundMesh, pose: Pose, vertices: Array) -> Array:
    """(k, 2) pixels: motion of the skin relative to the plane of the mesh."""
    skin = mesh.skin
    actual_px = pixel_from_head(mesh.camera, pose, vertices[skin.vertices])
    return actual_px - pixel_from_camera(mesh.camera, _moved_with_head(mesh, pose, skin.rigid_mm))


def _moved_with_head(mesh: BackgroundMesh, pose: Pose, points_mm: Array) -> Array:
    """Camera-frame points (..., 3), mm, moved with the head from the reference to `pose`."""
    reference = mesh.reference
    rotation = matrix_from_quaternion(multiply(pose.rotation, conjugate(reference.rotation)))
    return np.asarray((points_mm - reference.translation_mm) @ rotation.T + pose.translation_mm)


def _motion_falloff(mesh: BackgroundMesh, motion: Array) -> Array:
    """1 on the head and its hair, 0 beyond a reach that increases with the motion of the head."""
    on_head = motion[mesh.distance_px == 0]
    largest = float(np.linalg.norm(on_head, axis=-1).max(initial=0))
    # `smoothstep` is at most 1.5 steep.
    reach_px = max(FALLOFF_WIDTH * mesh.face_width_px, 1.5 * largest / MAX_STRAIN)
    return 1 - smoothstep(mesh.distance_px / reach_px)


def _hold_edges(mesh: BackgroundMesh, motion: Array) -> Array:
    """The motion with its inward part fading towards the picture's edge, which stays in place."""
    grid_px, reach = mesh.grid_px, mesh.face_width_px
    head = grid_px[mesh.distance_px == 0].reshape(-1, 2)
    first, last = grid_px[0, 0], grid_px[-1, -1]
    least = reach / CELLS_PER_FACE
    before = np.clip(np.min(head, axis=0, initial=np.inf) - first, least, reach)
    after = np.clip(last - np.max(head, axis=0, initial=-np.inf), least, reach)
    from_first = smoothstep((grid_px - first) / before)
    from_last = smoothstep((last - grid_px) / after)
    return np.maximum(motion, 0) * from_first + np.minimum(motion, 0) * from_last


def smoothstep(x: ArrayLike) -> Array:
    """0 below 0, 1 above 1, between them 3 x^2 - 2 x^3: smooth to the first derivative."""
    x = np.clip(np.asarray(x, dtype=np.float64), 0, 1)
    return np.asarray(x * x * (3 - 2 * x))


def max_unfolded_step(grid: Array, motion: Array, min_area: float) -> float:
    """The largest s in [0, 1] for which each corner of grid + s * motion has `min_area` or more.

    grid, motion: (rows, columns, 2) float64.  Without the limit, the skin behind the cheek of a
    turned head would fold.
    """
    (across, moved_across), (down, moved_down) = (
        (np.diff(grid, axis=axis), np.diff(motion, axis=axis)) for axis in (1, 0)
    )
    steps = [1.0]
    for i, j in product((slice(-1), slice(1, None)), repeat=2):
        a, b = across[i], down[:, j]
        c, d = moved_across[i], moved_down[:, j]
        # The corner's area is constant + linear s + quadratic s^2.
        constant, linear, quadratic = (
            _cross(a, b) - min_area,
            _cross(a, d) + _cross(c, b),
            _cross(c, d),
        )
        risky = (constant > 0) & (constant + np.minimum(linear, 0) + np.minimum(quadratic, 0) < 0)
        if risky.any():
            steps.append(_first_root(constant[risky], linear[risky], quadratic[risky]))
    return min(steps)


def _first_root(constant: Array, linear: Array, quadratic: Array) -> float:
    """The least positive root of polynomials that are positive at 0; infinity if there is none."""
    root = np.sqrt(np.maximum(linear**2 - 4 * quadratic * constant, 0))
    real = linear**2 >= 4 * quadratic * constant
    # This form of the roots is also valid for linear polynomials.
    divisors = np.concatenate([(root - linear)[real], (-root - linear)[real]])
    numerators = np.tile(2 * constant[real], 2)
    return float(np.min(numerators[divisors > 0] / divisors[divisors > 0], initial=np.inf))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
