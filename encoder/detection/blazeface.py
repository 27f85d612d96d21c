"""The BlazeFace face detector (Bazarevsky et al. 2019)."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from encoder.detection.detector import KEYPOINTS, Detection, by_size
from encoder.detection.ssd import SsdNetwork, Tile, weighted_nms
from encoder.detection.tflite import FULL_RANGE, SHORT_RANGE, TfliteNetwork
from shared_model.arrays import Picture

# Detections of smaller faces are mostly false.
_MIN_FACE_PX = 20
# Smaller tiles are not searched.
_MIN_TILE_PX = 48
# Tiles that a search by parts looks at in each frame, besides the whole picture: a frame of 640x480
# has 23, and all of them take 130 to 170 ms.
_TILES_PER_PART = 3
# Width of the border around a picture that may show a part of a face only, in terms of its longer
# side; and the least size of such a face, in terms of the shorter one.
_CUT_OFF_BORDER, _CUT_OFF_SHARE = 0.6, 0.6


class BlazeFaceDetector:
    """Runs the short-range and the full-range network on square tiles of a picture.

    folder: holds the .tflite files, see `find_network_folder`.
    threshold: least score of a face in the whole picture; tiles need a higher one.
    """

    def __init__(self, folder: Path, threshold: float = 0.6) -> None:
        short, full = (TfliteNetwork(folder / name) for name in (SHORT_RANGE, FULL_RANGE))
        self._networks = (
            SsdNetwork(short, 128, [(16, 2), (8, 6)], len(KEYPOINTS), low=-1.0),
            SsdNetwork(full, 192, [(48, 1)], len(KEYPOINTS), low=-1.0),
        )
        self._threshold = threshold
        self._next_part = 0  # of a search by parts

    def detect(self, frame: Picture) -> list[Detection]:
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

    def detect_part(self, frame: Picture) -> list[Detection]:
        """The faces in the whole of `frame`, the largest first, or in the next of its tiles.

        Called frame after frame it sees all tiles within some frames, and takes no frame long.
        """
        found = self.detect_large(frame)
        if found:
            return found
        _, *parts = _tiles(frame.shape[1], frame.shape[0])
        tiles = [tile for part in parts for tile in part]
        starts = range(0, len(tiles), _TILES_PER_PART)
        number = self._next_part % (1 + len(starts))
        self._next_part = number + 1
        if not number:
            return by_size(weighted_nms(self._cut_off(frame)))
        start = starts[number - 1]
        some = tiles[start : start + _TILES_PER_PART]
        return by_size(weighted_nms(self._found(frame, some, (1 + self._threshold) / 2)))

    def detect_large(self, frame: Picture) -> list[Detection]:
        """The faces that are large in the whole of `frame`, the largest first."""
        whole = next(_tiles(frame.shape[1], frame.shape[0]))
        return by_size(weighted_nms(self._found(frame, whole, self._threshold)))

    def _found(self, frame: Picture, tiles: list[Tile], threshold: float) -> list[Detection]:
        candidates = [face for tile in tiles for face in self._detect_in(frame, tile)]
        return [f for f in candidates if f.score > threshold and f.size_px >= _MIN_FACE_PX]

    def _cut_off(self, frame: Picture) -> list[Detection]:
        """Faces about as large as `frame` or larger, whose edges the picture cuts off.

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

    def _detect_in(self, frame: Picture, tile: Tile) -> Iterator[Detection]:
        for network in self._networks:
            yield from network.detect(frame, tile, self._threshold)


def _shifted(face: Detection, by_px: float) -> Detection:
    return Detection(face.box + by_px, face.keypoints + by_px, face.score)


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
