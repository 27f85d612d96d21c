"""Where faces are: BlazeFace (see haar.py for Viola-Jones)."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detection.tflite import FULL_RANGE, SHORT_RANGE, Network

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

# Order of `Detection.keypoints`; left and right are the subject's.
KEYPOINTS = ("eye_right", "eye_left", "nose", "mouth", "ear_right", "ear_left")


# Smaller ones are not worth a call, and mostly false.
_LEAST_PX = 20


@dataclass(frozen=True, slots=True)
class Detection:
    """A face found in a picture.

    box: (4,) float64, pixels: left, top, right, bottom of brow-to-chin; may leave the picture.
    keypoints: (6, 2) float64, pixels, in the order of `KEYPOINTS`.
    score: confidence in [0, 1].
    """

    box: Array
    keypoints: Array
    score: float

    @property
    def size_px(self) -> float:
        """Geometric mean of the box's sides, pixels."""
        width, height = self.box[2:] - self.box[:2]
        return float(np.sqrt(width * height))


class FaceDetector(Protocol):
    """Anything that finds faces in a (height, width, 3) uint8 BGR picture, the largest first."""

    def detect(self, frame: Frame) -> list[Detection]: ...


class BlazeFaceDetector:
    """BlazeFace (Bazarevsky et al. 2019), short and full range, over a pyramid of square crops.

    folder: where the .tflite files are (`networks.find_network_folder`).
    threshold: least score of a face seen at the first look.
    """

    def __init__(self, folder: Path, threshold: float = 0.6) -> None:
        self._short = Network(folder / SHORT_RANGE)
        self._full = Network(folder / FULL_RANGE)
        self._short_anchors = np.concatenate([_anchors(16, 2), _anchors(8, 6)])
        self._full_anchors = _anchors(48, 1)
        self._threshold = threshold

    def detect(self, frame: Frame) -> list[Detection]:
        """Faces in `frame`, the largest first; looks closer where the first look finds none."""
        threshold = self._threshold
        for squares in _pyramid(frame.shape[1], frame.shape[0]):
            seen = [face for square in squares for face in self._detect_in(frame, square)]
            found = [f for f in seen if f.score > threshold and f.size_px >= _LEAST_PX]
            if found:
                return largest_first(merge(found))
            # Crops are many and often of mere texture: ask for more certainty there.
            threshold = (1 + self._threshold) / 2
        return []

    def _detect_in(self, frame: Frame, square: tuple[int, int, int]) -> Iterator[Detection]:
        yield from self._run(self._short, 128, self._short_anchors, frame, square)
        yield from self._run(self._full, 192, self._full_anchors, frame, square)

    def _run(
        self, net: Network, size: int, anchors: Array, frame: Frame, square: tuple[int, int, int]
    ) -> Iterator[Detection]:
        left, top, side = square
        outputs = net.run(_crop(frame, square, size), low=-1.0)
        logits = np.clip(outputs[len(anchors)].astype(np.float64), -80, 80)
        raw = outputs[len(anchors) * 16].astype(np.float64).reshape(-1, 8, 2)
        scores = 1 / (1 + np.exp(-logits))
        for k in np.flatnonzero(scores > self._threshold):
            values = raw[k] / size
            values[[0, 2, 3, 4, 5, 6, 7]] += anchors[k]
            # The networks measure from the crop's corner, pixels from the first pixel's centre.
            scaled = values * side + [left - 0.5, top - 0.5]
            half = raw[k, 1] / size * side / 2
            box = np.concatenate([scaled[0] - half, scaled[0] + half])
            yield Detection(box, scaled[2:], float(scores[k]))


def largest_first(detections: list[Detection]) -> list[Detection]:
    """The same faces, sorted by size."""
    return sorted(detections, key=lambda face: -face.size_px)


def merge(detections: list[Detection], overlap: float = 0.3) -> list[Detection]:
    """One detection per face: those that overlap become their mean, weighted by score.

    overlap: intersection over union from which two detections are the same face.
    """
    rest = sorted(detections, key=lambda face: -face.score)
    merged = []
    while rest:
        best = rest[0]
        same = [face for face in rest if _overlap(best.box, face.box) > overlap]
        rest = [face for face in rest if _overlap(best.box, face.box) <= overlap]
        weights = np.array([face.score for face in same]) / sum(face.score for face in same)
        box = np.tensordot(weights, np.array([face.box for face in same]), 1)
        keypoints = np.tensordot(weights, np.array([face.keypoints for face in same]), 1)
        merged.append(Detection(box, keypoints, best.score))
    return merged


def _overlap(a: Array, b: Array) -> float:
    """Intersection over union, or over the smaller box where one lies within the other."""
    inner = np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0))
    areas = np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2])
    nested = inner > 0.8 * min(areas)
    return float(inner / (min(areas) if nested else sum(areas) - inner))


def _anchors(cells: int, repeats: int) -> Array:
    """(cells^2 * repeats, 2) centres of a square grid over [0, 1]^2, row by row."""
    steps = (np.arange(cells) + 0.5) / cells
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return np.repeat(grid, repeats, axis=0)


def _pyramid(width: int, height: int) -> Iterator[list[tuple[int, int, int]]]:
    """Square crops (left, top, side), pixels: the whole picture, then halves, then quarters."""
    long, short = max(width, height), min(width, height)
    yield [((width - long) // 2, (height - long) // 2, long)]
    for side in (short, long // 2, short // 2):
        if side >= 48:
            yield [(x, y, side) for y in _starts(height, side) for x in _starts(width, side)]


def _starts(length: int, side: int) -> list[int]:
    """Where crops of `side` begin so that they overlap by half and cover `length`."""
    if side >= length:
        return [(length - side) // 2]
    count = int(np.ceil(2 * (length - side) / side)) + 1
    return [round(start) for start in np.linspace(0, length - side, count)]


def _crop(frame: Frame, square: tuple[int, int, int], size: int) -> Frame:
    """The square (left, top, side) of `frame`, black outside it, resampled to size x size."""
    left, top, side = square
    height, width = frame.shape[:2]
    inside = frame[max(top, 0) : top + side, max(left, 0) : left + side]
    before = max(-top, 0), max(-left, 0)
    after = max(top + side - height, 0), max(left + side - width, 0)
    padded = cv2.copyMakeBorder(
        inside, before[0], after[0], before[1], after[1], cv2.BORDER_CONSTANT, value=(0, 0, 0)
    )
    method = cv2.INTER_AREA if side > size else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(padded, (size, size), interpolation=method), np.uint8)
