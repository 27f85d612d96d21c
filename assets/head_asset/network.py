"""Where the points of the landmark networks lie on the head: ask the networks themselves."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from assets.head_asset.mesh_parts import SKIN, Mesh
from assets.head_asset.paint import pixel_colours
from assets.head_asset.raster import Hits, view
from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.detection.landmarks import FaceMesh
from encoder.detection.roi import RotatedRoi, roi_from_landmarks
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, camera_from_head, pixel_from_head, pose_from_euler
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

POINTS = LANDMARK_COUNT
CAMERA = Camera(640, 640, 2000.0)
DISTANCE_MM = 900.0
BACKGROUND = (0.45, 0.5, 0.55)
# The middle of the face turns about the camera's axis, mm in the head frame.
FACE_CENTRE = np.array([0.0, -5.0, 60.0])


@dataclass(frozen=True, slots=True)
class Sight:
    """One view: pose, vertices (n, 3) drawn, hits, picture, each network's points (468, 2)."""

    pose: Pose
    vertices: Array
    hits: Hits
    picture: Picture
    answers: tuple[Array, ...]


def pose_towards(yaw_deg: float, pitch_deg: float) -> Pose:
    """The head turned about the middle of its face, in front of `CAMERA`."""
    turned = pose_from_euler(pitch_deg, yaw_deg, 0.0, np.zeros(3))
    moved = camera_from_head(turned, FACE_CENTRE)
    return Pose(turned.rotation, np.array([0.0, 0.0, DISTANCE_MM]) - moved)


def see(
    networks: Sequence[FaceMesh], mesh: Mesh, vertices: Array, yaw_deg: float, pitch_deg: float
) -> Sight:
    """Render the head and find the networks' points in the picture, pixels."""
    pose = pose_towards(yaw_deg, pitch_deg)
    hits = view(vertices, mesh.triangles, CAMERA, pose)
    picture = shade(mesh, vertices, pose, hits)
    face = vertices[(mesh.parts == SKIN) & (vertices[:, 2] > 20) & (vertices[:, 1] < 90)]
    outline = pixel_from_head(CAMERA, pose, face)
    low, high = outline.min(0), outline.max(0)
    square = RotatedRoi((low + high) / 2, 1.5 * float((high - low).max()), 0.0)
    return Sight(
        pose, vertices, hits, picture, tuple(_find(net, picture, square) for net in networks)
    )


def shade(mesh: Mesh, vertices: Array, pose: Pose, hits: Hits) -> Picture:
    """A BGR picture of painted skin under a soft frontal light."""
    seen = hits.triangle >= 0
    triangle, weights = hits.triangle[seen], hits.weights[seen]
    corners = mesh.triangles[triangle]
    normal = (weights[..., None] * vertex_normals(vertices, mesh.triangles)[corners]).sum(1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    turned = camera_from_head(Pose(pose.rotation, np.zeros(3)), normal)
    light = np.array([0.2, -0.45, -0.87])
    lit = 0.35 + 0.65 * np.clip(turned @ light, 0, 1)
    picture = np.tile(np.array(BACKGROUND), (*seen.shape, 1))
    picture[seen] = pixel_colours(mesh, triangle, weights) * lit[:, None]
    smooth = cv2.GaussianBlur(picture[..., ::-1], (0, 0), 0.8)
    return np.asarray(np.clip(smooth * 255 + 0.5, 0, 255), np.uint8)


def _find(network: FaceMesh, picture: Picture, square: RotatedRoi) -> Array:
    """(468, 2) pixels: looked for again and again where the last answer was, as in a video."""
    for _ in range(5):
        points = network.find(picture, square).points
        square = roi_from_landmarks(points)
    return points[:, :2]
