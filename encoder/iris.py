"""Irises and lids by MediaPipe's iris network under `cv2.dnn`, and the direction the eyes look.

The network takes longer for two eyes than the face mesh for the whole face; eyes can be asked for
every few frames.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.landmarks import Square
from encoder.networks import IRIS, Network
from shared_model.animate import Face
from shared_model.geometry import Camera, matrix_from_quaternion
from shared_model.jaw_and_lids import GAZE_DEG, eye
from shared_model.parameters import Pose

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

INPUT_PX = 64
CONTOUR, IRIS_POINTS = 71, 5
# Landmarks at the corners of the subject's right and left eye: outer, inner.
EYE_CORNERS = ((33, 133), (263, 362))
# The network was trained on crops this many times an eye's width.
_MARGIN = 2.3


@dataclass(frozen=True, slots=True)
class Eyes:
    """Both eyes of a face in a picture: the subject's right, then the left.

    irises: (2, 5, 2) float64, pixels: centre, then four points on the rim.
    contours: (2, 71, 2) float64, pixels: lids first, then what surrounds them up to the brow.
    """

    irises: Array
    contours: Array


class IrisFinder:
    """The iris network on the two eyes of a face whose landmarks are known.

    folder: where the .tflite files are.  Raises NetworkFilesMissing where this one is not.
    """

    def __init__(self, folder: Path) -> None:
        self._network = Network(folder / IRIS)

    def find(self, frame: Frame, points: Array) -> Eyes:
        """Eyes in `frame` (h, w, 3) uint8 BGR; points: (468, 3) landmarks, pixels."""
        found = [self._find_one(frame, points, side) for side in range(2)]
        irises, contours = zip(*found, strict=True)
        return Eyes(np.array(irises), np.array(contours))

    def _find_one(self, frame: Frame, points: Array, side: int) -> tuple[Array, Array]:
        pixel_from_crop = _eye_square(points, side).pixel_from_crop(INPUT_PX)
        if side == 1:
            # The network knows the eye on the picture's left: show it the other one mirrored.
            mirror = np.array([[-1.0, 0, INPUT_PX - 1], [0, 1, 0], [0, 0, 1]])
            pixel_from_crop = pixel_from_crop @ mirror
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        crop = cv2.warpAffine(
            frame, pixel_from_crop, (INPUT_PX,) * 2, flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        outputs = self._network.run(np.asarray(crop, np.uint8), low=0.0)
        return _points(outputs[3 * IRIS_POINTS], pixel_from_crop), _points(
            outputs[3 * CONTOUR], pixel_from_crop
        )


def gaze(face: Face, camera: Camera, pose: Pose, eyes: Eyes) -> Array:
    """(2,) the actuators gaze_horizontal and gaze_vertical of these eyes in a head of this pose.

    Where the ray through an iris' centre meets the eyeball, is where that eye looks; eyes agree.
    """
    angles = []
    for side, iris in zip("rl", eyes.irises, strict=True):
        ball = eye(face.neutral, face.head.parts, side)
        look = _meet(camera, pose, ball.centre, ball.radius, iris[0])
        angles.append([np.arctan2(look[0], look[2]), np.arcsin(np.clip(look[1], -1, 1))])
    return np.asarray(np.clip(np.degrees(np.mean(angles, axis=0)) / GAZE_DEG, -1.0, 1.0))


def _meet(camera: Camera, pose: Pose, centre_mm: Array, radius_mm: float, pixel: Array) -> Array:
    """(3,) unit vector, head frame, from an eyeball's centre to where a pixel's ray meets it."""
    rotation = matrix_from_quaternion(pose.rotation)
    ray = np.append((pixel - camera.centre) / camera.focal_px, 1.0)
    ray = rotation.T @ (ray / np.linalg.norm(ray))
    eye_from_camera = rotation.T @ pose.translation_mm + centre_mm
    along = float(ray @ eye_from_camera)
    nearest = along * ray - eye_from_camera
    # A ray that misses the ball altogether means its rim.
    inside = np.sqrt(max(radius_mm**2 - float(nearest @ nearest), 0.0))
    look = nearest - inside * ray
    return np.asarray(look / np.linalg.norm(look))


def _eye_square(points: Array, side: int) -> Square:
    outer, inner = points[list(EYE_CORNERS[side]), :2]
    along = (inner - outer) * (1 if side == 0 else -1)
    reach = float(np.max(np.abs(along)))
    return Square((outer + inner) / 2, _MARGIN * reach, float(np.arctan2(along[1], along[0])))


def _points(raw: NDArray[np.float32], pixel_from_crop: Array) -> Array:
    flat = raw.astype(np.float64).reshape(-1, 3)[:, :2] - 0.5
    return np.asarray(flat @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2])
