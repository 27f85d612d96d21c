"""Where the 468 points of the landmark network lie on the head: ask the network itself."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from scripts.head_asset.mesh_parts import Mesh
from scripts.head_asset.paint import pixel_colours
from scripts.head_asset.raster import Hits, view
from shared_model.geometry import Camera, camera_from_head, pixel_from_head, pose_from_euler
from shared_model.parameters import Pose

Array = NDArray[np.float64]

POINTS = 468
INPUT = 192
CAMERA = Camera(640, 640, 2000.0)
DISTANCE_MM = 900.0
BACKGROUND = (0.45, 0.5, 0.55)
# The middle of the face turns about the camera's axis, mm in the head frame.
FACE_CENTRE = np.array([0.0, -5.0, 60.0])


@dataclass(frozen=True, slots=True)
class Sight:
    """One view: its pose, vertices (n, 3) drawn, what was hit, the picture and the 468 points in it."""

    pose: Pose
    vertices: Array
    hits: Hits
    picture: NDArray[np.uint8]
    points: Array


def load_network(path: Path) -> cv2.dnn.Net:
    """The 468-point landmark network of a `face_landmark.tflite`."""
    return cv2.dnn.readNetFromTFLite(str(path))


def pose_towards(yaw_deg: float, pitch_deg: float) -> Pose:
    """The head turned about the middle of its face, in front of `CAMERA`."""
    turned = pose_from_euler(pitch_deg, yaw_deg, 0.0, np.zeros(3))
    moved = camera_from_head(turned, FACE_CENTRE)
    return Pose(turned.rotation, np.array([0.0, 0.0, DISTANCE_MM]) - moved)


def see(net: cv2.dnn.Net, mesh: Mesh, vertices: Array, yaw_deg: float, pitch_deg: float) -> Sight:
    """Render the head and find the network's points in the picture, pixels."""
    pose = pose_towards(yaw_deg, pitch_deg)
    hits = view(vertices, mesh.triangles, CAMERA, pose)
    picture = shade(mesh, vertices, pose, hits)
    face = vertices[(mesh.parts == 0) & (vertices[:, 2] > 20) & (vertices[:, 1] < 90)]
    points = pixel_from_head(CAMERA, pose, face)
    # The network expects the crop its own previous answer would give: iterate to a fixed point.
    for _ in range(5):
        points = _run(net, picture, points)
    return Sight(pose, vertices, hits, picture, points)


def shade(mesh: Mesh, vertices: Array, pose: Pose, hits: Hits) -> NDArray[np.uint8]:
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
    return np.clip(smooth * 255 + 0.5, 0, 255).astype(np.uint8)


def vertex_normals(vertices: Array, triangles: NDArray[np.integer]) -> Array:
    """(n, 3) unit normals, averaged by area."""
    corners = vertices[triangles]
    facet = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, triangles[:, k], facet)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def _run(net: cv2.dnn.Net, picture: NDArray[np.uint8], around: Array) -> Array:
    low, high = around[:, :2].min(0), around[:, :2].max(0)
    # MediaPipe's crop: a square half as large again as the landmarks' box.
    side = 1.5 * float((high - low).max())
    corner = (low + high) / 2 - side / 2
    scale = INPUT / side
    affine = np.array([[scale, 0, -corner[0] * scale], [0, scale, -corner[1] * scale]])
    crop = cv2.warpAffine(picture, affine, (INPUT, INPUT), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    net.setInput(cv2.dnn.blobFromImage(crop, 1 / 255, swapRB=True))
    outputs = net.forward(net.getUnconnectedOutLayersNames())
    answer = next(out for out in outputs if out.size == POINTS * 3).reshape(POINTS, 3)
    return np.asarray(answer[:, :2] / scale + corner, np.float64)
