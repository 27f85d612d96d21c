"""The inverse of the lapped transform, see `block_transform`, where tiles have values."""

from dataclasses import dataclass

import numpy as np

from protocol.picture_residual.block_transform import dct_matrix, lapping_matrix
from protocol.picture_residual.residual_block import BIAS, CHROMA_WEIGHT, ResidualTiles
from protocol.picture_residual.tile_coding import CHROMA_TILE, PLANE_STARTS, TILE
from protocol.pictures.picture_codec import LUMA_BGR
from runtime.jit import jit
from shared_model.arrays import Integers, Mask, Picture, Single

_SIDES = TILE, CHROMA_TILE, CHROMA_TILE
_BLUE, _GREEN, _RED = map(np.float32, LUMA_BGR)


@dataclass(frozen=True, slots=True)
class ResidualPictures:
    """The residual of a group of frames, before it is filtered across the borders of tiles.

    places: (rows, columns) index of each tile that has values, -1 of the others.
    blocks: of each plane (frames, tiles, side, side).
    """

    places: Integers
    blocks: tuple[Single, ...]

    @classmethod
    def from_tiles(cls, tiles: ResidualTiles) -> "ResidualPictures":
        """Dequantise and transform."""
        coded = tiles.flags > 0
        places = np.where(coded, np.cumsum(coded).reshape(coded.shape) - 1, -1)
        integers = tiles.values[coded].astype(np.float32)
        steps = np.where(tiles.flags[coded] == 2, tiles.step / 2, tiles.step).astype(np.float32)
        values = np.sign(integers) * np.maximum(np.abs(integers) - np.float32(BIAS), 0)
        values *= steps[:, None, None]
        frames = values.shape[1]
        in_time = np.tensordot(dct_matrix(frames), values, (0, 1))
        blocks = []
        for plane, side in enumerate(_SIDES):
            start, dct = PLANE_STARTS[plane], dct_matrix(side)
            own = in_time[..., start : start + side**2].reshape(frames, -1, side, side)
            blocks.append(dct.T @ own @ dct)
        return cls(places.astype(np.int64), tuple(blocks))

    def add_to(self, picture: Picture, frame: int) -> Picture:
        """A picture (h, w, 3) uint8 BGR with the residual of a frame of the group."""
        rows, columns = self.places.shape
        planes, touched = [], np.zeros(self.places.shape, np.bool_)
        for blocks, side in zip(self.blocks, _SIDES, strict=True):
            plane = np.zeros((rows * side, columns * side), np.float32)
            _place(self.places, blocks[frame], lapping_matrix(side), plane, touched)
            planes.append(plane)
        result = picture.copy()
        _add(result, touched, *planes)
        return result


@jit
def _place(places: Integers, blocks: Single, lapping: Single, plane: Single, touched: Mask) -> None:
    """Write the blocks (tiles, side, side) into a plane and filter across their borders.

    touched: (rows, columns) tiles where the plane may not be 0; written.
    """
    rows, columns, side = places.shape[0], places.shape[1], blocks.shape[1]
    half, around = side // 2, np.zeros(side, np.float32)
    for row in range(rows):
        for column in range(columns):
            if places[row, column] >= 0:
                block = blocks[places[row, column]]
                for i in range(side):
                    for j in range(side):
                        plane[row * side + i, column * side + j] = block[i, j]
    spread = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            if places[row, column] >= 0:
                spread[row, max(column - 1, 0) : column + 2] = True
        for column in range(1, columns):
            if places[row, column] < 0 and places[row, column - 1] < 0:
                continue
            first = column * side - half
            for i in range(row * side, (row + 1) * side):
                around[:] = plane[i, first : first + side]
                for j in range(side):
                    total = np.float32(0)
                    for k in range(side):
                        total += lapping[k, j] * around[k]
                    plane[i, first + j] = total
    for row in range(rows):
        for column in range(columns):
            if spread[row, column]:
                touched[max(row - 1, 0) : row + 2, column] = True
            if not row or not (spread[row, column] or spread[row - 1, column]):
                continue
            first, left = row * side - half, column * side
            _filter_rows(lapping, plane[first : first + side, left : left + side])


@jit
def _filter_rows(lapping: Single, samples: Single) -> None:
    """Filter samples (side, side) across the border of rows in their middle."""
    side = len(samples)
    around = samples.copy()
    for i in range(side):
        for j in range(side):
            samples[i, j] = 0
        for k in range(side):
            weight = lapping[k, i]
            for j in range(side):
                samples[i, j] += weight * around[k, j]


@jit
def _add(picture: Picture, touched: Mask, luma: Single, first: Single, second: Single) -> None:
    """Add luma and colour differences to a picture (h, w, 3), BGR, in the tiles that they touch."""
    height, width = picture.shape[0], picture.shape[1]
    half, low, high = np.float32(0.5), np.float32(0), np.float32(255)
    per_weight = np.float32(1 / CHROMA_WEIGHT)
    for row in range(touched.shape[0]):
        for column in range(touched.shape[1]):
            if not touched[row, column]:
                continue
            for i in range(row * TILE, min((row + 1) * TILE, height)):
                for j in range(column * TILE, min((column + 1) * TILE, width)):
                    y = luma[i, j]
                    blue = y + per_weight * first[i // 2, j // 2]
                    red = y + per_weight * second[i // 2, j // 2]
                    green = (y - _BLUE * blue - _RED * red) / _GREEN
                    pixel = picture[i, j]
                    pixel[0] = np.uint8(min(max(pixel[0] + blue + half, low), high))
                    pixel[1] = np.uint8(min(max(pixel[1] + green + half, low), high))
                    pixel[2] = np.uint8(min(max(pixel[2] + red + half, low), high))
