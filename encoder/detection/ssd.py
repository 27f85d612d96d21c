"""Single-shot detectors (SSD, Liu et al. 2016) of the kind of BlazeFace: boxes and keypoints about
the cells of a grid, found in square tiles of a picture."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from encoder.detection.detector import Detection
from encoder.detection.tflite import TfliteNetwork
from runtime.area_resize import area_resized
from shared_model.arrays import Array, Picture

# A square of a picture: left, top, side, pixels; it may leave the picture.
Tile = tuple[int, int, int]


class SsdNetwork:
    """A network whose input is `size` x `size` pixels.

    grids: (cells along a side, anchors in each cell) of each of its grids.
    keypoints: of each detection.  low: see `TfliteNetwork.run`.
    """

    def __init__(
        self,
        network: TfliteNetwork,
        size: int,
        grids: Sequence[tuple[int, int]],
        keypoints: int,
        low: float,
    ) -> None:
        self._network, self._size, self._low = network, size, low
        self._anchors = np.concatenate([ssd_anchors(*grid) for grid in grids])
        self._points = 2 + keypoints

    def detect(self, frame: Picture, tile: Tile, threshold: float) -> Iterator[Detection]:
        """What is in a tile of `frame` (h, w, 3) uint8 BGR with a score above the threshold."""
        left, top, side = tile
        outputs = self._network.run(_crop_tile(frame, tile, self._size), self._low)
        count = len(self._anchors)
        logits = np.clip(outputs[count].astype(np.float64), -80, 80)
        raw = outputs[count * 2 * self._points].astype(np.float64).reshape(-1, self._points, 2)
        scores = 1 / (1 + np.exp(-logits))
        for k in np.flatnonzero(scores > threshold):
            values = raw[k] / self._size
            values[[0, *range(2, self._points)]] += self._anchors[k]
            # Networks measure from the tile's corner, pixels from the centre of the first pixel.
            scaled = values * side + [left - 0.5, top - 0.5]
            half = raw[k, 1] / self._size * side / 2
            box = np.concatenate([scaled[0] - half, scaled[0] + half])
            yield Detection(box, scaled[2:], float(scores[k]))


def ssd_anchors(cells: int, repeats: int) -> Array:
    """(cells^2 * repeats, 2) centres of the cells of a square grid over [0, 1]^2, row by row."""
    steps = (np.arange(cells) + 0.5) / cells
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return np.repeat(grid, repeats, axis=0)


def weighted_nms(detections: list[Detection], min_iou: float = 0.3) -> list[Detection]:
    """Weighted non-maximum suppression: overlapping detections become one, their mean by score.

    min_iou: overlap, see `_overlap`, above which two detections are of the same thing.
    """
    rest = sorted(detections, key=lambda each: -each.score)
    merged = []
    while rest:
        best = rest[0]
        same = [each for each in rest if _overlap(best.box, each.box) > min_iou]
        rest = [each for each in rest if _overlap(best.box, each.box) <= min_iou]
        weights = np.array([each.score for each in same]) / sum(each.score for each in same)
        box = np.tensordot(weights, np.array([each.box for each in same]), 1)
        keypoints = np.tensordot(weights, np.array([each.keypoints for each in same]), 1)
        merged.append(Detection(box, keypoints, best.score))
    return merged


def _overlap(a: Array, b: Array) -> float:
    """Intersection over union, or over the smaller box if most of it lies in the other."""
    inner = np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0))
    areas = np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2])
    nested = inner > 0.8 * min(areas)
    return float(inner / (min(areas) if nested else sum(areas) - inner))


def _crop_tile(frame: Picture, tile: Tile, size: int) -> Picture:
    """The tile of `frame`, black outside the frame, resampled to size x size."""
    left, top, side = tile
    height, width = frame.shape[:2]
    inside = frame[max(top, 0) : top + side, max(left, 0) : left + side]
    before = max(-top, 0), max(-left, 0)
    after = max(top + side - height, 0), max(left + side - width, 0)
    padded = cv2.copyMakeBorder(
        inside, before[0], after[0], before[1], after[1], cv2.BORDER_CONSTANT, value=(0, 0, 0)
    )
    if side > size:
        return area_resized(np.asarray(padded, np.uint8), (size, size))
    return np.asarray(cv2.resize(padded, (size, size), interpolation=cv2.INTER_LINEAR), np.uint8)
