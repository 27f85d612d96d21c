"""The BlazeFace face detector (Bazarevsky et al. 2019)."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.detection.detector import Detection, by_size
from encoder.detection.tflite import FULL_RANGE, SHORT_RANGE, TfliteNetwork

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]
# A square of a picture: left, top, side, pixels; it may leave the picture.
Tile = tuple[int, int, int]

# Detections of smaller faces are mostly false.
_MIN_FACE_PX = 20
# Smaller tiles are not searched.
_MIN_TILE_PX = 48
# Width of the border around a picture that may show a part of a face only, in terms of its longer
# side; and the least size of such a face, in terms of the shorter one.
_CUT_OFF_BORDER, _CUT_OFF_SHARE = 0.6, 0.6


class BlazeFaceDetector:
    """Runs the short-range and the full-range network on square tiles of a picture.

    folder: holds the .tflite files, see `find_network_folder`.
    threshold: least score of a face in the whole picture; tiles need a higher one.
    """

    def __init__(self, folder: Path, threshold: float = 0.6) -> None:
        self._short = TfliteNetwork(folder / SHORT_RANGE)
        self._full = TfliteNetwork(folder / FULL_RANGE)
        self._short_anchors = np.concatenate([_anchors(16, 2), _anchors(8, 6)])
        self._full_anchors = _anchors(48, 1)
        self._threshold = threshold

    def detect(self, frame: Frame) -> list[Detection]:
        """Faces in `frame` (h, w, 3) uint8 BGR, the largest first.

        Smaller tiles are searched only if larger ones show no face.
        """
        whole, *parts = _tiles(frame.shape[1], frame.shape[0])
        found = self._found(frame, whole, self._threshold) or self._cut_off(frame)
        # Many tiles show no face at all: a higher threshold keeps false detections rare.
        threshold = (1 + self._threshold) / 2
        for tiles in parts:
            found = found or self._found(frame, tiles, threshold)
        return by_size(weighted_nms(found))

    def detect_large(self, frame: Frame) -> list[Detection]:
        """The faces that are large in the whole of `frame`, the largest first."""
        whole = next(_tiles(frame.shape[1], frame.shape[0]))
        return by_size(weighted_nms(self._found(frame, whole, self._threshold)))

    def _found(self, frame: Frame, tiles: list[Tile], threshold: float) -> list[Detection]:
        candidates = [face for tile in tiles for face in self._detect_in(frame, tile)]
        return [f for f in candidates if f.score > threshold and f.size_px >= _MIN_FACE_PX]

    def _cut_off(self, frame: Frame) -> list[Detection]:
        """Faces that are about as large as `frame` or larger, so that parts of them are cut off.

        The networks know whole faces: they see the picture within a border of its mean colour.
        """
        height, width = frame.shape[:2]
        border = round(_CUT_OFF_BORDER * max(width, height))
        mean = [float(value) for value in frame.mean(axis=(0, 1))]
        sides = border, border, border, border
        framed = cv2.copyMakeBorder(frame, *sides, cv2.BORDER_CONSTANT, value=mean)
        whole = next(_tiles(width + 2 * border, height + 2 * border))
        found = self._found(np.asarray(framed, np.uint8), whole, self._threshold)
        least_px = _CUT_OFF_SHARE * min(width, height)
        return [_shifted(face, -border) for face in found if face.size_px >= least_px]

    def _detect_in(self, frame: Frame, tile: Tile) -> Iterator[Detection]:
        yield from self._run(self._short, 128, self._short_anchors, frame, tile)
        yield from self._run(self._full, 192, self._full_anchors, frame, tile)

    def _run(
        self, network: TfliteNetwork, size: int, anchors: Array, frame: Frame, tile: Tile
    ) -> Iterator[Detection]:
        """The detections of one network, whose input is size x size pixels."""
        left, top, side = tile
        outputs = network.run(_crop_tile(frame, tile, size), low=-1.0)
        logits = np.clip(outputs[len(anchors)].astype(np.float64), -80, 80)
        raw = outputs[len(anchors) * 16].astype(np.float64).reshape(-1, 8, 2)
        scores = 1 / (1 + np.exp(-logits))
        for k in np.flatnonzero(scores > self._threshold):
            values = raw[k] / size
            values[[0, 2, 3, 4, 5, 6, 7]] += anchors[k]
            # Networks measure from the tile's corner, pixels from the centre of the first pixel.
            scaled = values * side + [left - 0.5, top - 0.5]
            half = raw[k, 1] / size * side / 2
            box = np.concatenate([scaled[0] - half, scaled[0] + half])
            yield Detection(box, scaled[2:], float(scores[k]))


def _shifted(face: Detection, by_px: float) -> Detection:
    return Detection(face.box + by_px, face.keypoints + by_px, face.score)


def weighted_nms(detections: list[Detection], min_iou: float = 0.3) -> list[Detection]:
    """Weighted non-maximum suppression: overlapping detections become one, their mean by score.

    min_iou: overlap, see `_overlap`, above which two detections are of the same face.
    """
    rest = sorted(detections, key=lambda face: -face.score)
    merged = []
    while rest:
        best = rest[0]
        same = [face for face in rest if _overlap(best.box, face.box) > min_iou]
        rest = [face for face in rest if _overlap(best.box, face.box) <= min_iou]
        weights = np.array([face.score for face in same]) / sum(face.score for face in same)
        box = np.tensordot(weights, np.array([face.box for face in same]), 1)
        keypoints = np.tensordot(weights, np.array([face.keypoints for face in same]), 1)
        merged.append(Detection(box, keypoints, best.score))
    return merged


def _overlap(a: Array, b: Array) -> float:
    """Intersection over union, or over the smaller box if most of it lies in the other."""
    inner = np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0))
    areas = np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2])
    nested = inner > 0.8 * min(areas)
    return float(inner / (min(areas) if nested else sum(areas) - inner))


def _anchors(cells: int, repeats: int) -> Array:
    """(cells^2 * repeats, 2) centres of the cells of a square grid over [0, 1]^2, row by row."""
    steps = (np.arange(cells) + 0.5) / cells
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return np.repeat(grid, repeats, axis=0)


def _tiles(width: int, height: int) -> Iterator[list[Tile]]:
    """Tiles of a picture, a list for each size: the whole picture, then ever smaller parts."""
    long, short = max(width, height), min(width, height)
    yield [((width - long) // 2, (height - long) // 2, long)]
    for side in (short, long // 2, short // 2):
        if side >= _MIN_TILE_PX:
            yield [
                (x, y, side) for y in _tile_starts(height, side) for x in _tile_starts(width, side)
            ]


def _tile_starts(length: int, side: int) -> list[int]:
    """First pixels of tiles of `side` that cover `length` and overlap by about half."""
    if side >= length:
        return [(length - side) // 2]
    count = int(np.ceil(2 * (length - side) / side)) + 1
    return [round(start) for start in np.linspace(0, length - side, count)]


def _crop_tile(frame: Frame, tile: Tile, size: int) -> Frame:
    """The tile of `frame`, black outside the frame, resampled to size x size."""
    left, top, side = tile
    height, width = frame.shape[:2]
    inside = frame[max(top, 0) : top + side, max(left, 0) : left + side]
    before = max(-top, 0), max(-left, 0)
    after = max(top + side - height, 0), max(left + side - width, 0)
    padded = cv2.copyMakeBorder(
        inside, before[0], after[0], before[1], after[1], cv2.BORDER_CONSTANT, value=(0, 0, 0)
    )
    method = cv2.INTER_AREA if side > size else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(padded, (size, size), interpolation=method), np.uint8)
