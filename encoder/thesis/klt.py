"""Kanade-Lucas-Tomasi tracking of rigid points, reprojected from the head model (thesis 5.2)."""

from dataclasses import dataclass

import cv2
import numpy as np

from encoder.capture.colour import luma_u8
from encoder.thesis.vertex_visibility import VertexVisibility
from shared_model.animate import Face
from shared_model.arrays import Array, Mask, Picture, Single, VertexIndices
from shared_model.geometry import Camera, matrix_from_quaternion, pixel_from_head
from shared_model.parameters import FaceParameters, Pose

EYE_DISTANCE_MM = 62.0
# Larger faces are tracked at this distance between the eyes: more pixels cost time only.
_WORKING_PX = 80.0
# Points are weighted down by the largest motion that an actuator gives them.
_MUSCLE_MOTION_MM = 1.5
# Which points are tracked: features of the first frame, or wherever they become visible.
KLT_POINTS = ("first", "visible")
# Everything below is in units of the distance between the eyes.
_SPACING = 0.16
_WINDOW = 0.26
_FORWARD_BACKWARD = 0.008
_SIGMA = 0.008
# Hidden points are replaced where fewer than this share of them is visible, and the head has turned
# by this much since it was looked for others.
_LEAST_VISIBLE, _TURNED_DEG = 0.95, 10.0
# Candidates whose visibility is computed together.
_CANDIDATE_BLOCK = 100


@dataclass(frozen=True, slots=True)
class Tracks:
    """Tracked points of one frame, see `Measurements`.

    points_mm: (n, 3) float64, mm, head frame, in the predicted expression.
    pixels: (n, 2) float64.  variance_px2: (n,) float64, infinite where not tracked.
    inlier_share: share of the visible points that were tracked, 0..1.
    """

    points_mm: Array
    pixels: Array
    variance_px2: Array
    inlier_share: float


@dataclass(frozen=True, slots=True)
class _ReferenceFrame:
    """Luma of a frame; pixels (n, 2) of the points in it, from the fitted model; visible (n,)."""

    luma: Picture
    pixels: Array
    visible: Mask


class KltTracker:
    """Tracks a number of rigid points from each frame to the next.

    face: the person's head.  frame, camera, start: a fitted first frame, whose features are used.
    count: number of points, at most.
    replace_hidden: points that a turn of the head hides give way to features that it shows; their
        number stays what it is.

    Frames are (h, w, 3) uint8 BGR, or faster (h, w) from `luma_u8`.
    The reference of each frame is the frame before it, as in the thesis.  Several reference frames
    at different poses do not drift, but their tracks jitter two to five times as much.
    """

    def __init__(
        self,
        face: Face,
        frame: Picture,
        camera: Camera,
        start: FaceParameters,
        count: int = 40,
        replace_hidden: bool = False,
    ) -> None:
        luma = luma_u8(frame)
        self._replaces_hidden = replace_hidden
        self._searched_at = _view_direction(start.pose)
        self.index = select_features(face, luma, camera, start, count)
        self.set_face(face)
        self._previous = self._reference(luma, camera, start)

    def track(self, frame: Picture, camera: Camera, predicted: FaceParameters) -> Tracks:
        """Track the points into `frame`, from their predicted positions."""
        points = self._points.animate(predicted.eau)
        expected = pixel_from_head(camera, predicted.pose, points)
        visible = self._visibility.visible(predicted.pose) & self._previous.visible
        eyes_px = eye_distance_px(camera, predicted.pose)
        pixels, ok = _flow_forward_backward(
            self._previous, luma_u8(frame), expected, visible, eyes_px
        )
        variance = np.where(ok, max(_SIGMA * eyes_px, 0.1) ** 2, np.inf)
        share = float(ok.sum() / max(visible.sum(), 1))
        return Tracks(points, np.where(ok[:, None], pixels, expected), variance, share)

    def set_face(self, face: Face) -> None:
        """Use the same points on this head from now on."""
        self._face = face
        self._points = face.at_vertices(self.index)
        self._visibility = VertexVisibility(face.neutral, face.head.triangles, self.index)

    def reset_points(self, frame: Picture, camera: Camera, fitted: FaceParameters) -> None:
        """Reproject the points from the fitted face: the reference of the next frame."""
        luma = luma_u8(frame)
        if self._replaces_hidden:
            self._replace_hidden(luma, camera, fitted)
        self._previous = self._reference(luma, camera, fitted)

    def _replace_hidden(self, luma: Picture, camera: Camera, fitted: FaceParameters) -> None:
        visible = self._visibility.visible(fitted.pose)
        direction = _view_direction(fitted.pose)
        cosine = float(direction @ self._searched_at)
        if visible.mean() >= _LEAST_VISIBLE or cosine > np.cos(np.radians(_TURNED_DEG)):
            return
        self._searched_at = direction
        pixels = pixel_from_head(camera, fitted.pose, self._face.animate(fitted.eau))
        least_px = _SPACING * eye_distance_px(camera, fitted.pose)
        index, hidden = self.index.copy(), list(np.flatnonzero(~visible))
        for vertex in select_features(self._face, luma, camera, fitted, len(index)):
            kept = np.delete(index, hidden)
            apart = np.linalg.norm(pixels[kept] - pixels[vertex], axis=1).min(initial=np.inf)
            if hidden and apart > least_px:
                index[hidden.pop()] = vertex
        self.index = index
        self.set_face(self._face)

    def _reference(self, luma: Picture, camera: Camera, fitted: FaceParameters) -> _ReferenceFrame:
        pixels = pixel_from_head(camera, fitted.pose, self._points.animate(fitted.eau))
        visible = self._visibility.visible(fitted.pose) & _inside(pixels, luma.shape)
        return _ReferenceFrame(luma, pixels, visible)


def select_features(
    face: Face, luma: Picture, camera: Camera, start: FaceParameters, count: int
) -> VertexIndices:
    """(n <= count,) vertices to track: visible, textured, spaced apart, moved little by muscles."""
    head = face.head
    candidates = np.flatnonzero((head.parts == 0) & (head.opacity > 0.5)).astype(np.int32)
    pixels = pixel_from_head(camera, start.pose, face.animate(start.eau)[candidates])
    inside = _inside(pixels, luma.shape)
    candidates, pixels = candidates[inside], pixels[inside]
    eyes_px = eye_distance_px(camera, start.pose)
    motion_mm = np.maximum(
        *(np.linalg.norm(f, axis=2).max(axis=0) for f in (head.eau_up, head.eau_down))
    )
    rigidity = np.exp(-((motion_mm[candidates] / _MUSCLE_MOTION_MM) ** 2))
    order = np.argsort(-(_corner_response(luma, pixels, eyes_px) * rigidity))
    chosen: list[int] = []
    # In blocks, since visibility is slow to compute and most candidates are not needed.
    for block in np.array_split(order, max(1, len(order) // _CANDIDATE_BLOCK)):
        visible = VertexVisibility(face.neutral, head.triangles, candidates[block]).visible(
            start.pose
        )
        for k in block[visible]:
            distances = np.linalg.norm(pixels[chosen] - pixels[k], axis=1)
            if distances.min(initial=np.inf) > _SPACING * eyes_px:
                chosen.append(int(k))
            if len(chosen) == count:
                return candidates[chosen]
    return candidates[chosen]


def _corner_response(luma: Picture, pixels: Array, eyes_px: float) -> Array:
    """(n,) smaller eigenvalue of the structure tensor around each pixel (Shi and Tomasi)."""
    block = max(3, round(_WINDOW * eyes_px) | 1)
    corners = cv2.cornerMinEigenVal(luma, block)
    x, y = np.round(pixels).astype(int).T
    return np.asarray(corners[y, x], np.float64)


def _flow_forward_backward(
    reference: _ReferenceFrame, luma: Picture, expected: Array, visible: Mask, eyes_px: float
) -> tuple[Array, Mask]:
    """Pixels (n, 2) of the reference's points, and whether the backward flow returns to them."""
    if visible.sum() < 3:
        return expected, np.zeros(len(expected), dtype=np.bool_)
    work_from_pixel, size = _working_area(expected[visible], eyes_px)
    pixel_from_reference = _affine(reference.pixels[visible], expected[visible])
    template = _warp(reference.luma, _compose(work_from_pixel, pixel_from_reference), size)
    current = _warp(luma, work_from_pixel, size)
    start = _apply(_compose(work_from_pixel, pixel_from_reference), reference.pixels).astype(
        np.float32
    )
    guess = _apply(work_from_pixel, expected).astype(np.float32)
    work_eyes = eyes_px * float(work_from_pixel[0, 0])
    forward, found = _flow(template, current, start, guess, work_eyes)
    backward, returned = _flow(current, template, forward, start, work_eyes)
    error = np.linalg.norm(backward - start, axis=1)
    ok = visible & found & returned & (error < max(_FORWARD_BACKWARD * work_eyes, 0.3))
    pixel_from_work = np.asarray(cv2.invertAffineTransform(work_from_pixel), np.float64)
    pixels = _apply(pixel_from_work, forward.astype(np.float64))
    return pixels, ok & _inside(pixels, luma.shape)


def _flow(
    first: Picture,
    second: Picture,
    points: Single,
    guess: Single,
    eyes: float,
) -> tuple[Single, Mask]:
    window = max(7, round(_WINDOW * eyes) | 1)
    target, status, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        points,
        guess.copy(),
        winSize=(window, window),
        maxLevel=2,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.005),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=1e-4,
    )
    return np.asarray(target, np.float32).reshape(-1, 2), np.asarray(status, bool).ravel()


def _working_area(pixels: Array, eyes_px: float) -> tuple[Array, tuple[int, int]]:
    """(2, 3) affine map from pixels to a crop around the points, and the crop's size."""
    scale = min(1.0, _WORKING_PX / eyes_px)
    margin = 2 * _WINDOW * eyes_px
    low, high = pixels.min(axis=0) - margin, pixels.max(axis=0) + margin
    width, height = np.ceil((high - low) * scale).astype(int) + 1
    work_from_pixel = np.column_stack([scale * np.eye(2), -scale * low])
    return work_from_pixel, (int(width), int(height))


def _affine(source: Array, target: Array) -> Array:
    """(2, 3) affine map that takes source (n, 2) to target (n, 2) with the least squared error."""
    ones = np.column_stack([source, np.ones(len(source))])
    return np.asarray(np.linalg.lstsq(ones, target, rcond=None)[0].T)


def _apply(affine: Array, points: Array) -> Array:
    return np.asarray(points @ affine[:, :2].T + affine[:, 2])


def _compose(second: Array, first: Array) -> Array:
    """(2, 3) affine map that applies `first`, then `second`."""
    composed = second[:, :2] @ first
    composed[:, 2] += second[:, 2]
    return np.asarray(composed)


def _warp(luma: Picture, work_from_pixel: Array, size: tuple[int, int]) -> Picture:
    border = cv2.BORDER_REPLICATE
    warped = cv2.warpAffine(luma, work_from_pixel, size, flags=cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(warped, np.uint8)


def _inside(pixels: Array, shape: tuple[int, ...]) -> Mask:
    return np.asarray(((pixels >= 0) & (pixels <= np.array(shape[1::-1]) - 1)).all(axis=1))


def _view_direction(pose: Pose) -> Array:
    """(3,) the direction of the camera's axis in the head's axes."""
    return np.asarray(matrix_from_quaternion(pose.rotation)[2])


def eye_distance_px(camera: Camera, pose: Pose) -> float:
    """Distance between the eyes of an average head in frontal view at this depth, pixels."""
    return float(camera.focal_px * EYE_DISTANCE_MM / pose.translation_mm[2])
