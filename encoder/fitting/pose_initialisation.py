"""Pose from points: from three under weak perspective (thesis 5.1), from many under perspective."""

import cv2
import numpy as np

from encoder.detection.detector import Detection
from shared_model.arrays import Array
from shared_model.geometry import (
    FRONTAL,
    Camera,
    conjugate,
    multiply,
    normalise,
    quaternion_from_matrix,
    vector_from_quaternion,
)
from shared_model.mesh import Head
from shared_model.parameters import Pose


def anchor_points(head: Head) -> Array:
    """(3, 3) mm, head frame: right eye, left eye, tip of the nose; thesis 5.1's three anchors."""
    marks = head.landmarks
    eyes = [head.vertices[[marks[f"ex_{s}"], marks[f"en_{s}"]]].mean(axis=0) for s in "rl"]
    return np.array([*eyes, head.vertices[marks["prn"]]])


def pose_from_three_points(head: Head, camera: Camera, face: Detection) -> Pose:
    """The rough pose of a detected face from its eyes and nose (WP3P)."""
    return weak_perspective_pose(camera, anchor_points(head), face.keypoints[:3])


def weak_perspective_pose(camera: Camera, points_mm: Array, pixels: Array) -> Pose:
    """The pose that projects three points onto three pixels under scaled orthography (Alter 1992).

    Of the two solutions, mirrored in depth, the one closer to a frontal face is returned.

    points_mm: (3, 3) float64, mm, head frame, not on one line.
    pixels: (3, 2) float64, no two the same.
    Raises ValueError where the shapes are wrong or the points degenerate.
    """
    if points_mm.shape != (3, 3) or pixels.shape != (3, 2):
        raise ValueError(f"expected (3, 3) and (3, 2), got {points_mm.shape} and {pixels.shape}")
    scale, depths = _scale_and_depths(points_mm, pixels)
    z_mm = camera.focal_px / scale
    centre = np.append((pixels.mean(axis=0) - camera.centre) / scale, z_mm)
    poses = []
    for side in (1.0, -1.0):
        camera_mm = np.column_stack([pixels / scale, side * depths])
        rotation = _triangle_frame(camera_mm) @ _triangle_frame(points_mm).T
        translation = centre - rotation @ points_mm.mean(axis=0)
        poses.append(Pose(quaternion_from_matrix(rotation), translation))
    return min(poses, key=_angle_from_frontal)


def pose_from_points(
    camera: Camera, points_mm: Array, pixels: Array, start: Pose | None = None
) -> Pose:
    """The pose that projects head points onto pixels with the least squared error.

    points_mm: (k, 3) float64, mm, head frame, k >= 4.  pixels: (k, 2) float64.
    start: initial pose of the iterations; None searches all poses.
    Raises ValueError where the shapes do not match or there is no solution.
    """
    if points_mm.ndim != 2 or points_mm.shape[1] != 3 or len(points_mm) < 4:
        raise ValueError(f"points_mm has shape {points_mm.shape}, expected (k >= 4, 3)")
    if pixels.shape != (len(points_mm), 2):
        raise ValueError(f"pixels has shape {pixels.shape}, expected ({len(points_mm)}, 2)")
    object_points = np.ascontiguousarray(points_mm)
    # Pixels relative to the principal point: its convention stays in `Camera`.
    image_points = np.ascontiguousarray(pixels - camera.centre)
    intrinsics = np.diag([camera.focal_px, camera.focal_px, 1.0])
    if start is None:
        flag = cv2.SOLVEPNP_SQPNP
        ok, rvec, tvec = cv2.solvePnP(object_points, image_points, intrinsics, None, flags=flag)
        if not ok:
            raise ValueError("no pose projects these points onto these pixels")
    else:
        rvec = vector_from_quaternion(start.rotation).reshape(3, 1)
        tvec = np.asarray(start.translation_mm, np.float64).reshape(3, 1).copy()
    rvec, tvec = cv2.solvePnPRefineLM(object_points, image_points, intrinsics, None, rvec, tvec)
    rotation = quaternion_from_matrix(np.asarray(cv2.Rodrigues(rvec)[0], np.float64))
    return Pose(rotation, np.asarray(tvec, np.float64).ravel())


def _scale_and_depths(points_mm: Array, pixels: Array) -> tuple[float, Array]:
    """Pixels per mm, and the three points' depths, mm, about their mean (Alter 1992, section 4).

    All sides of the triangle are known in space and in the picture; the difference of a side's
    squares is its squared depth.  Depths that close the triangle give a quadratic in scale squared.
    """
    space = np.sum((points_mm[[1, 2, 2]] - points_mm[[0, 0, 1]]) ** 2, axis=1)
    picture = np.sum((pixels[[1, 2, 2]] - pixels[[0, 0, 1]]) ** 2, axis=1)
    a, b, c = _heron_form(space, space), _heron_form(space, picture), _heron_form(picture, picture)
    if a < 1e-9 * np.max(space) ** 2 or np.min(picture) <= 0:
        raise ValueError("the three points lie on one line, or two pixels are the same")
    scale_squared = (b + np.sqrt(max(b * b - a * c, 0.0))) / a
    squared_depths = np.maximum(scale_squared * space - picture, 0.0)
    first, second = np.sqrt(squared_depths[:2])
    # The third is (first - second)^2, or (first + second)^2 on opposite sides of the first point.
    if squared_depths[0] + squared_depths[1] < squared_depths[2]:
        second = -second
    scale = float(np.sqrt(scale_squared))
    depths = np.array([0.0, first, second]) / scale
    return scale, depths - depths.mean()


def _heron_form(p: Array, q: Array) -> float:
    """Bilinear form of squared sides: 16 times the squared area of a triangle where p equals q."""
    return float(p.sum() * q.sum() - 2 * p @ q)


def _triangle_frame(points: Array) -> Array:
    """(3, 3) orthonormal axes, as columns, of a triangle with corners (3, 3)."""
    side = points[1] - points[0]
    normal = np.cross(side, points[2] - points[0])
    side, normal = side / np.linalg.norm(side), normal / np.linalg.norm(normal)
    return np.column_stack([side, np.cross(normal, side), normal])


def _angle_from_frontal(pose: Pose) -> float:
    """Angle between the pose and that of a frontal face, radians."""
    rotation = multiply(normalise(pose.rotation), conjugate(np.array(FRONTAL)))
    return float(np.linalg.norm(vector_from_quaternion(rotation)))
