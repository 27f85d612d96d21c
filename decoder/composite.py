"""How the still picture behind the head moves with it: the backdrop's mesh, as plain arrays.

Each mesh point is lifted to the depth plane that the head origin had in the reference frame, moved
rigidly with the head, and projected again.  Near the outline of the head it follows fully (hair and
ears belong to the head); over about a face width it follows less and less.  Below the chin it
follows the translation of the head rather than its rotation, since the neck holds still.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.geometry import (
    Camera,
    conjugate,
    matrix_from_quaternion,
    multiply,
    pixel_from_camera,
    pixel_from_head,
)
from shared_model.mesh import Head
from shared_model.parameters import Pose

Array = NDArray[np.float64]

MAX_COLUMNS, MAX_ROWS = 48, 36
CELL_PX = 16
# Distances from the head's outline, in face widths.
HAIR_MARGIN = 0.15
REACH = 1.0
NECK_LENGTH = 0.6
# A point may move by this part of the distance over which its motion fades: smoothstep is at most
# 1.5 steep, so the map stays invertible.
STEEPEST = 0.55


@dataclass(frozen=True, slots=True)
class Backdrop:
    """The still picture's mesh and how much of the head's motion each of its points takes.

    camera, reference: how the still was taken.
    face_width_px: width of the face in the still.
    grid_px: (rows, columns, 2) float64, pixels, the mesh at rest; its rim is the picture's edge.
    lifted_mm: (rows, columns, 3) float64, camera frame, mm: the points in the depth of the head.
    distance_px: (rows, columns) float64, pixels, from the head and its hair; 0 within.
    turning: (rows, columns) float64 in [0, 1]: how much of the head's rotation a point takes.
    """

    camera: Camera
    reference: Pose
    face_width_px: float
    grid_px: Array
    lifted_mm: Array
    distance_px: Array
    turning: Array


def make_backdrop(camera: Camera, reference: Pose, head: Head, vertices: Array) -> Backdrop:
    """The backdrop of a still in which `head` was posed like `reference`.

    vertices: (n, 3) float64, mm, head frame: the head in the still.
    """
    grid_px = _grid(camera)
    outline_px = pixel_from_head(camera, reference, vertices)
    face_px = outline_px[head.opacity > 0]
    face_width_px = float(np.ptp(face_px[:, 0]))
    nearest_px = _nearest(grid_px.reshape(-1, 2), outline_px).reshape(grid_px.shape[:2])
    depth_mm = reference.translation_mm[2]
    lifted = np.concatenate(
        [
            (grid_px - camera.centre) * depth_mm / camera.focal_px,
            np.full((*grid_px.shape[:2], 1), depth_mm),
        ],
        axis=-1,
    )
    return Backdrop(
        camera=camera,
        reference=reference,
        face_width_px=face_width_px,
        grid_px=grid_px,
        lifted_mm=lifted,
        distance_px=np.maximum(nearest_px - HAIR_MARGIN * face_width_px, 0),
        turning=_turning(camera, reference, grid_px, vertices, face_width_px),
    )


def warp(backdrop: Backdrop, pose: Pose) -> Array:
    """Where the mesh lies when the head is posed like `pose`: (rows, columns, 2), pixels."""
    reference, lifted = backdrop.reference, backdrop.lifted_mm
    shift = pose.translation_mm - reference.translation_mm
    rotation = matrix_from_quaternion(multiply(pose.rotation, conjugate(reference.rotation)))
    turned = (lifted - reference.translation_mm) @ rotation.T + pose.translation_mm
    moved = lifted + shift
    target_mm = moved + backdrop.turning[..., None] * (turned - moved)
    motion = pixel_from_camera(backdrop.camera, target_mm) - backdrop.grid_px
    weight = _falloff(backdrop, motion)
    return backdrop.grid_px + _hold_edges(backdrop, weight[..., None] * motion)


def _grid(camera: Camera) -> Array:
    columns = min(MAX_COLUMNS, -(-camera.width // CELL_PX)) + 1
    rows = min(MAX_ROWS, -(-camera.height // CELL_PX)) + 1
    u = np.linspace(-0.5, camera.width - 0.5, columns)
    v = np.linspace(-0.5, camera.height - 0.5, rows)
    return np.stack(np.meshgrid(u, v), axis=-1)


def _nearest(points: Array, targets: Array) -> Array:
    """(p,) distance of each of `points` (p, 2) from the nearest of `targets` (n, 2)."""
    squared = [((points - target) ** 2).sum(axis=1) for target in targets]
    return np.asarray(np.sqrt(np.min(squared, axis=0)))


def _turning(
    camera: Camera, reference: Pose, grid_px: Array, vertices: Array, face_width_px: float
) -> Array:
    """1 down to the chin, then falling to 0 along the neck."""
    down = -matrix_from_quaternion(reference.rotation)[:2, 1]
    down /= np.linalg.norm(down)
    chin_px = float(np.max(pixel_from_head(camera, reference, vertices) @ down))
    below = (grid_px @ down - chin_px) / (NECK_LENGTH * face_width_px)
    return 1 - smoothstep(below)


def _falloff(backdrop: Backdrop, motion: Array) -> Array:
    """1 on the head and its hair, 0 beyond the reach, which grows with the motion of the head."""
    on_head = backdrop.distance_px == 0
    largest = float(np.linalg.norm(motion[on_head], axis=-1).max()) if on_head.any() else 0.0
    reach_px = max(REACH * backdrop.face_width_px, 1.5 * largest / STEEPEST)
    return 1 - smoothstep(backdrop.distance_px / reach_px)


def _hold_edges(backdrop: Backdrop, motion: Array) -> Array:
    """Let nothing come in from beyond the picture: inward motion fades between head and edge."""
    grid_px, reach = backdrop.grid_px, REACH * backdrop.face_width_px
    head = grid_px[backdrop.distance_px == 0].reshape(-1, 2)
    first, last = grid_px[0, 0], grid_px[-1, -1]
    before = np.clip(np.min(head, axis=0, initial=np.inf) - first, CELL_PX, reach)
    after = np.clip(last - np.max(head, axis=0, initial=-np.inf), CELL_PX, reach)
    from_first = smoothstep((grid_px - first) / before)
    from_last = smoothstep((last - grid_px) / after)
    return np.maximum(motion, 0) * from_first + np.minimum(motion, 0) * from_last


def smoothstep(x: Array) -> Array:
    """0 below 0, 1 above 1, between them 3 x^2 - 2 x^3: smooth to the first derivative."""
    x = np.clip(x, 0, 1)
    return np.asarray(x * x * (3 - 2 * x))
