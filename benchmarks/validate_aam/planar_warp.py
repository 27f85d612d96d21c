"""The 2D AAM that the head is compared with (thesis 2.2, 3.1): landmarks, similarity, piecewise
affine warp.

Its shapes are the coordinates of landmarks, aligned by a similarity (x to the right, y down, the
outer corners of the eyes at the distance of the head's), its pose is (turn, x, y, log scale).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from aam.annotation.landmark_schemes import IBUG_68
from aam.texture_frame import texture_frame
from aam.training.faces import AnnotatedFace
from aam.window import FaceWindow
from shared_model.arrays import Array, Indices, Picture, Single, VertexIndices

# Landmarks of the network that the 2D AAM uses: a scheme of 68.
PLANAR_LANDMARKS = IBUG_68
# In `PLANAR_LANDMARKS`: corners of the eyes, as in `Warp.eye_corners`.
EYE_CORNERS = (36, 39, 42, 45)
# Between the outer corners of the eyes, mm.
EYE_DISTANCE_MM = 90.0
ALIGNMENTS = 5
POSE_NAMES = ("turn", "tx", "ty", "scale")
# The mirror image of each landmark.
MIRRORED = (
    *range(16, -1, -1),
    *range(26, 16, -1),
    *(27, 28, 29, 30, 35, 34, 33, 32, 31),
    *(45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40),
    *(54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55),
    *(64, 63, 62, 61, 60, 67, 66, 65),
)


class PlanarWarp:
    """See `aam.warps.Warp`.

    size: of the 3D head's atlas; the texture has as many texels as the head's full frame there.
    mean: (68, 2) mean shape.
    """

    pose_names = POSE_NAMES
    eye_corners = EYE_CORNERS

    def __init__(self, size: int, mean: Array) -> None:
        self.size = size
        wanted = len(texture_frame(size, "full").rows)
        rows, columns, places = _texels(mean, wanted, size)
        triangles = _delaunay(mean)
        number, weights = _barycentric(mean[triangles], places)
        inside = weights.min(1) > -1e-6
        self.rows, self.columns = rows[inside], columns[inside]
        self._corners = triangles[number[inside]]
        self._weights = weights[inside].astype(np.float32)
        self.width, self.height = float(np.ptp(mean[:, 0])), float(np.ptp(mean[:, 1]))

    def positions(self, shape: Array, pose: Array) -> Single:
        """See `Warp`."""
        points = self.landmarks(shape, pose).astype(np.float32)
        return np.asarray(np.einsum("kc,kcd->dk", self._weights, points[self._corners]))

    def landmarks(self, shape: Array, pose: Array) -> Array:
        """(68, 2) pixels."""
        return np.asarray(np.exp(pose[3]) * shape.reshape(-1, 2) @ _turned(pose[0]).T + pose[1:3])

    def displaced(self, pose: Array, step: Array) -> Array:
        """See `Warp`."""
        shift = np.exp(pose[3]) * _turned(pose[0]) @ step[1:3]
        return np.array([pose[0] + step[0], *(pose[1:3] + shift), pose[3] + step[3]])

    def step_between(self, pose: Array, target: Array) -> Array:
        """See `Warp`."""
        shift = _turned(pose[0]).T @ (target[1:3] - pose[1:3]) / np.exp(pose[3])
        return np.array([target[0] - pose[0], *shift, target[3] - pose[3]])

    def upright(self, turn: float, place: Array) -> Array:
        """See `Warp`."""
        return np.array([turn, *place])


def planar_face(face: AnnotatedFace, landmarks_px: Array, mean: Array) -> AnnotatedFace:
    """The face with the shape and the pose of the 2D AAM.

    landmarks_px: (68, 2) in pixels of its window.  mean: (68, 2) mean shape.
    """
    pose = similarity(mean, landmarks_px)
    aligned = (landmarks_px - pose[1:3]) @ _turned(pose[0]) / np.exp(pose[3])
    return AnnotatedFace(face.name, face.person, face.window, aligned.ravel(), pose)


def mirrored_planar(window: FaceWindow, landmarks_px: Array) -> tuple[FaceWindow, Array]:
    """The mirror image of a window and its landmarks (68, 2)."""
    picture: Picture = np.ascontiguousarray(window.picture[:, ::-1])
    points = landmarks_px[list(MIRRORED)] * [-1, 1] + [picture.shape[1] - 1, 0]
    return FaceWindow(picture, window.corner, window.ratio), points


def mean_shape(landmarks_px: Sequence[Array]) -> Array:
    """(68, 2) mean of aligned landmarks, each (68, 2) (Procrustes), about its middle, in mm."""
    mean = _normalised(landmarks_px[0])
    for _ in range(ALIGNMENTS):
        total = np.zeros_like(mean)
        for points in landmarks_px:
            pose = similarity(mean, points)
            total += (points - pose[1:3]) @ _turned(pose[0]) / np.exp(pose[3])
        mean = _normalised(total / len(landmarks_px))
    return mean


def similarity(points: Array, target: Array) -> Array:
    """(4,) the pose at which points (m, 2) come nearest to others, least squares."""
    a, b = points - points.mean(0), target - target.mean(0)
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    rotation = _turned(turn)
    scale = float((a @ rotation.T * b).sum() / (a**2).sum())
    shift = target.mean(0) - scale * rotation @ points.mean(0)
    return np.array([turn, *shift, np.log(scale)])


def _normalised(points: Array) -> Array:
    middle = points - points.mean(0)
    along = middle[EYE_CORNERS[3]] - middle[EYE_CORNERS[0]]
    turn = float(np.arctan2(along[1], along[0]))
    return np.asarray(middle @ _turned(turn) * EYE_DISTANCE_MM / np.linalg.norm(along))


def _turned(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _texels(mean: Array, wanted: int, size: int) -> tuple[VertexIndices, VertexIndices, Array]:
    """Rows, columns and places (k, 2), mm, of about `wanted` texels within the outline of the
    shape, in a square of `size`.
    """
    hull = cv2.convexHull(mean.astype(np.float32))
    step = float(np.sqrt(cv2.contourArea(hull) / wanted))
    low = mean.min(0)
    columns, rows = np.meshgrid(np.arange(size), np.arange(size))
    places = np.stack([columns.ravel(), rows.ravel()], 1) * step + low + step / 2
    inside = np.array(
        [cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0 for x, y in places]
    )
    chosen = [each.ravel()[inside].astype(np.int32) for each in (rows, columns)]
    return chosen[0], chosen[1], places[inside]


def _delaunay(points: Array) -> VertexIndices:
    low, high = points.min(0) - 1, points.max(0) + 2
    corner, sides = np.floor(low).astype(int).tolist(), np.ceil(high - low).astype(int).tolist()
    division = cv2.Subdiv2D((*corner, *sides))
    division.insert([(float(x), float(y)) for x, y in points])
    corners = np.asarray(division.getTriangleList(), float).reshape(-1, 3, 2)
    distance = np.linalg.norm(corners[:, :, None] - points[None, None], axis=-1)
    found = distance.argmin(-1)[distance.min(-1).max(-1) < 1e-2]
    return np.asarray(found, np.int32)


def _barycentric(corners: Array, places: Array) -> tuple[Indices, Array]:
    """For each place (k, 2) the triangle that holds it and its weights (k, 3).

    corners: (t, 3, 2).
    """
    homogeneous = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2)
    inverse = np.linalg.inv(homogeneous.transpose(0, 2, 1))
    weights = np.einsum("tij,kj->kti", inverse, np.column_stack([places, np.ones(len(places))]))
    number = weights.min(2).argmax(1)
    return number, weights[np.arange(len(places)), number]
