"""Hands near a face: MediaPipe's palm detector and hand landmark networks (Zhang et al. 2020)."""

import threading

import cv2
import numpy as np

from encoder.detection.detector import Detection
from encoder.detection.roi import RotatedRoi, crop_roi
from encoder.detection.ssd import SsdNetwork, Tile, weighted_nms
from encoder.detection.tflite import HandNetworkFiles, TfliteNetwork
from shared_model.arrays import Array, Picture

# The palm detector: pixels of its input, its grids, see `SsdNetwork`, and its keypoints, of which
# two are the wrist and the root of the middle finger.
PALM_PX, PALM_GRIDS, PALM_KEYPOINTS = 192, [(24, 2), (12, 6)], 7
WRIST, MIDDLE_ROOT = 0, 2
# Least score of a palm, and probability that its surroundings show a hand.
MIN_PALM_SCORE, MIN_HAND_SCORE = 0.5, 0.5
# Pixels of the input of the network that finds the joints, and their number.
HAND_PX, JOINTS = 224, 21
# The hand around a palm: side of its square and how far its centre lies towards the fingers, in
# terms of the palm's.
HAND_SIDE, TOWARDS_FINGERS = 2.6, 0.5
# The joints lie within the hand: its outline is further out, in terms of the length of the palm;
# and so much of the forearm is in the way, too.
FLESH, FOREARM = 0.22, 1.0
# The root of the middle finger among the joints; the wrist is the first.
MIDDLE_ROOT_JOINT = 9
# Side of the square in which hands are searched, and how far its centre lies below the face's, in
# terms of the face's extent.
WINDOW, BELOW = 4.0, 0.8


class HandFinder:
    """Finds hands; each thread that uses it has networks of its own.

    Raises `NetworkFilesMissing` if a network cannot be read.
    """

    def __init__(self, files: HandNetworkFiles) -> None:
        self._files, self._of_thread = files, threading.local()
        self._networks()

    def find(self, frame: Picture, window: Tile) -> list[Array]:
        """The outlines (k, 2), pixels, of hands in a window of `frame` (h, w, 3) uint8 BGR."""
        palms, joints = self._networks()
        found = weighted_nms(list(palms.detect(frame, window, MIN_PALM_SCORE)))
        hands = [_joints(joints, frame, _hand_roi(palm)) for palm in found]
        return [hand_outline(hand) for hand in hands if hand is not None]

    def _networks(self) -> tuple[SsdNetwork, TfliteNetwork]:
        if not hasattr(self._of_thread, "networks"):
            palms = TfliteNetwork(self._files.palms)
            detector = SsdNetwork(palms, PALM_PX, PALM_GRIDS, PALM_KEYPOINTS, low=0.0)
            self._of_thread.networks = detector, TfliteNetwork(self._files.joints)
        networks: tuple[SsdNetwork, TfliteNetwork] = self._of_thread.networks
        return networks


def window_around(points_px: Array) -> Tile:
    """The square around a face with these points (k, >= 2), pixels, that hands may reach into."""
    low, high = points_px[:, :2].min(0), points_px[:, :2].max(0)
    extent = float((high - low).max())
    side = max(2, round(WINDOW * extent))
    left, top = np.rint((low + high - side) / 2 + [0, BELOW * extent]).astype(int).tolist()
    return left, top, side


def hand_outline(joints_px: Array) -> Array:
    """(k, 2) the outline of a hand and of a part of its forearm; joints_px: (21, 2) pixels."""
    wrist, palm = joints_px[0], joints_px[0] - joints_px[MIDDLE_ROOT_JOINT]
    length = float(np.linalg.norm(palm))
    around = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    disc = FLESH * length * np.stack([np.cos(around), np.sin(around)], -1)
    solid = np.concatenate([joints_px, wrist[None] + FOREARM * palm])
    grown = (solid[:, None] + disc).reshape(-1, 2)
    return np.asarray(cv2.convexHull(grown.astype(np.float32))[:, 0], np.float64)


def _hand_roi(palm: Detection) -> RotatedRoi:
    """The square, turned so that the fingers point upwards, that shows the hand of a palm."""
    towards = palm.keypoints[MIDDLE_ROOT] - palm.keypoints[WRIST]
    roll = float(np.arctan2(towards[0], -towards[1]))
    side = float(np.max(palm.box[2:] - palm.box[:2]))
    up = np.array([np.sin(roll), -np.cos(roll)])
    centre = (palm.box[:2] + palm.box[2:]) / 2 + TOWARDS_FINGERS * side * up
    return RotatedRoi(centre, HAND_SIDE * side, roll)


def _joints(network: TfliteNetwork, frame: Picture, roi: RotatedRoi) -> Array | None:
    """(21, 2) pixels: the joints of the hand in a square; None if it shows no hand."""
    joints, score, *_ = network.outputs(crop_roi(frame, roi, HAND_PX), low=0.0)
    if float(score[0]) < MIN_HAND_SCORE:
        return None
    pixel_from_crop = roi.pixel_from_crop(HAND_PX)
    flat = joints.astype(np.float64).reshape(JOINTS, 3)[:, :2] - 0.5
    return np.asarray(flat @ pixel_from_crop[:, :2].T + pixel_from_crop[:, 2])
