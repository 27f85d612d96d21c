"""Kanade-Lucas-Tomasi tracking of rigid points that the head model chooses and puts back (5.2)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma_u8
from encoder.tracking.vertex_visibility import VertexVisibility
from shared_model.animate import Face
from shared_model.geometry import Camera, pixel_from_head
from shared_model.parameters import FaceParameters, Pose

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]
Grey = NDArray[np.uint8]
Indices = NDArray[np.int32]
Mask = NDArray[np.bool_]

EYE_DISTANCE_MM = 62.0
# Faces are followed at no more than this many pixels between the eyes: finer costs time only.
_WORKING_PX = 80.0
# A muscle moves a point of this weight as far as it is worth following.
_STILL_MM = 1.5
# Everything below is in units of the distance between the eyes.
_SPACING = 0.16
_WINDOW = 0.26
_RETURN = 0.008
_SIGMA = 0.008
# Points whose visibility is worked out together.
_LOOKED_AT = 100


@dataclass(frozen=True, slots=True)
class Tracks:
    """Where the points of one frame were seen; arguments of `FaceFilter.update`.

    points_mm: (n, 3) float64, mm, head frame, in the predicted expression.
    pixels: (n, 2) float64.  variance_px2: (n,) float64, infinite where not seen.
    share: how many of the points that should be visible were followed, 0..1.
    """

    points_mm: Array
    pixels: Array
    variance_px2: Array
    inlier_share: float


@dataclass(frozen=True, slots=True)
class _View:
    """A picture in which the points' places are known from the fitted model."""

    grey: Grey
    pixels: Array
    seen: Mask


class KltTracker:
    """Follows a fixed set of rigid points from one frame to the next.

    face: the caller's head.  frame, camera, start: a fitted first frame; points are chosen in it.
    count: how many points, at most.

    Frames are (h, w, 3) uint8 BGR or, which saves time, (h, w) `luma_u8`.
    Each frame follows from the one before, as in the thesis.  Following from the nearest of several
    kept views instead did not drift, but jittered two to five times as much and fitted no better.
    """

    def __init__(
        self,
        face: Face,
        frame: Frame,
        camera: Camera,
        start: FaceParameters,
        count: int = 40,
    ) -> None:
        grey = luma_u8(frame)
        self.index = select_features(face, grey, camera, start, count)
        self.set_face(face)
        self._last = self._view(grey, camera, start)

    def track(self, frame: Frame, camera: Camera, predicted: FaceParameters) -> Tracks:
        """Find the points in `frame` near where the prediction has them."""
        points = self._points.animate(predicted.eau)
        expected = pixel_from_head(camera, predicted.pose, points)
        visible = self._visibility.visible(predicted.pose) & self._last.seen
        eyes_px = eye_distance_px(camera, predicted.pose)
        pixels, ok = _follow(self._last, luma_u8(frame), expected, visible, eyes_px)
        variance = np.where(ok, max(_SIGMA * eyes_px, 0.1) ** 2, np.inf)
        share = float(ok.sum() / max(visible.sum(), 1))
        return Tracks(points, np.where(ok[:, None], pixels, expected), variance, share)

    def set_face(self, face: Face) -> None:
        """The same points are on this head from now on."""
        self._points = face.at(self.index)
        self._visibility = VertexVisibility(face.neutral, face.head.triangles, self.index)

    def reset_points(self, frame: Frame, camera: Camera, fitted: FaceParameters) -> None:
        """Take the fitted model's word for where the points are in `frame`."""
        self._last = self._view(luma_u8(frame), camera, fitted)

    def _view(self, grey: Grey, camera: Camera, fitted: FaceParameters) -> _View:
        pixels = pixel_from_head(camera, fitted.pose, self._points.animate(fitted.eau))
        return _View(
            grey, pixels, self._visibility.visible(fitted.pose) & _inside(pixels, grey.shape)
        )


def select_features(
    face: Face, grey: Grey, camera: Camera, start: FaceParameters, count: int
) -> Indices:
    """(n <= count,) vertices worth following: visible, textured, apart, in muscle-free zones."""
    head = face.head
    candidates = np.flatnonzero((head.parts == 0) & (head.opacity > 0.5)).astype(np.int32)
    pixels = pixel_from_head(camera, start.pose, face.animate(start.eau)[candidates])
    inside = _inside(pixels, grey.shape)
    candidates, pixels = candidates[inside], pixels[inside]
    eyes_px = eye_distance_px(camera, start.pose)
    moved = np.maximum(
        *(np.linalg.norm(f, axis=2).max(axis=0) for f in (head.eau_up, head.eau_down))
    )
    worth = _texturedness(grey, pixels, eyes_px) * np.exp(-((moved[candidates] / _STILL_MM) ** 2))
    order = np.argsort(-worth)
    chosen: list[int] = []
    # Whether a point is hidden takes long to tell; most are never asked for.
    for block in np.array_split(order, max(1, len(order) // _LOOKED_AT)):
        visible = VertexVisibility(face.neutral, head.triangles, candidates[block]).visible(
            start.pose
        )
        for k in block[visible]:
            near = np.linalg.norm(pixels[chosen] - pixels[k], axis=1)
            if near.min(initial=np.inf) > _SPACING * eyes_px:
                chosen.append(int(k))
            if len(chosen) == count:
                return candidates[chosen]
    return candidates[chosen]


def _texturedness(grey: Grey, pixels: Array, eyes_px: float) -> Array:
    """(n,) smaller eigenvalue of the structure tensor around each pixel (Shi and Tomasi)."""
    block = max(3, round(_WINDOW * eyes_px) | 1)
    corners = cv2.cornerMinEigenVal(grey, block)
    x, y = np.round(pixels).astype(int).T
    return np.asarray(corners[y, x], np.float64)


def _follow(
    view: _View, grey: Grey, expected: Array, visible: Mask, eyes_px: float
) -> tuple[Array, Mask]:
    """Where the view's points went: pixels (n, 2), and which were found there and back."""
    if visible.sum() < 3:
        return expected, np.zeros(len(expected), dtype=np.bool_)
    work_from_pixel, size = _working_area(expected[visible], eyes_px)
    pixel_from_view = _affine(view.pixels[visible], expected[visible])
    template = _warp(view.grey, _compose(work_from_pixel, pixel_from_view), size)
    current = _warp(grey, work_from_pixel, size)
    start = _apply(_compose(work_from_pixel, pixel_from_view), view.pixels).astype(np.float32)
    guess = _apply(work_from_pixel, expected).astype(np.float32)
    work_eyes = eyes_px * float(work_from_pixel[0, 0])
    there, found = _flow(template, current, start, guess, work_eyes)
    back, returned = _flow(current, template, there, start, work_eyes)
    miss = np.linalg.norm(back - start, axis=1)
    ok = visible & found & returned & (miss < max(_RETURN * work_eyes, 0.3))
    pixel_from_work = np.asarray(cv2.invertAffineTransform(work_from_pixel), np.float64)
    pixels = _apply(pixel_from_work, there.astype(np.float64))
    return pixels, ok & _inside(pixels, grey.shape)


def _flow(
    first: Grey, second: Grey, points: NDArray[np.float32], guess: NDArray[np.float32], eyes: float
) -> tuple[NDArray[np.float32], Mask]:
    window = max(7, round(_WINDOW * eyes) | 1)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
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
    return np.asarray(moved, np.float32).reshape(-1, 2), np.asarray(status, bool).ravel()


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
    """The affine map that is `first`, then `second`."""
    turned = second[:, :2] @ first
    turned[:, 2] += second[:, 2]
    return np.asarray(turned)


def _warp(grey: Grey, work_from_pixel: Array, size: tuple[int, int]) -> Grey:
    border = cv2.BORDER_REPLICATE
    warped = cv2.warpAffine(grey, work_from_pixel, size, flags=cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(warped, np.uint8)


def _inside(pixels: Array, shape: tuple[int, ...]) -> Mask:
    return np.asarray(((pixels >= 0) & (pixels <= np.array(shape[1::-1]) - 1)).all(axis=1))


def eye_distance_px(camera: Camera, pose: Pose) -> float:
    """How far apart the eyes of a usual head are that is seen from before, pixels."""
    return float(camera.focal_px * EYE_DISTANCE_MM / pose.translation_mm[2])
