"""The inverse of the lapped transform, see `block_transform`, where tiles have values."""

from dataclasses import dataclass

import numpy as np

from protocol.picture_residual.block_transform import dct_matrix, lapping_matrix
from protocol.picture_residual.residual_block import BIAS, CHROMA_WEIGHT, ResidualTiles
from protocol.picture_residual.tile_coding import plane_start
from protocol.pictures.picture_codec import LUMA_BGR
from runtime.jit import jit
from shared_model.arrays import Integers, Mask, Picture, Single

_BLUE, _GREEN, _RED = map(np.float32, LUMA_BGR)


@dataclass(frozen=True, slots=True)
class ResidualPictures:
    """The residual of a group of frames, before it is filtered across the borders of tiles.

    places: (2, rows, columns) index of each tile that has values, -1 of the others; of those with
        the whole step, then of fine ones.
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
        for plane in range(3):
            side = tiles.side // 2 if plane else tiles.side
            start, dct = plane_start(plane, tiles.side), dct_matrix(side)
            own = in_time[..., start : start + side**2].reshape(frames, -1, side, side)
            blocks.append(dct.T @ own @ dct)
        of_kinds = [np.where(tiles.flags == kind, places, -1) for kind in (1, 2)]
        return cls(np.array(of_kinds, np.int64), tuple(blocks))

    def add_to(self, picture: Picture, frame: int, face_area: Single) -> Picture:
        """A picture (h, w, 3) uint8 BGR with the residual of a frame of the group.

        face_area: (h, w) where the face is: there fine tiles alone are added.
        """
        _, rows, columns = self.places.shape
        touched, sums = np.zeros((rows, columns), np.bool_), list[Single]()
        for blocks in self.blocks:
            side = blocks.shape[-1]
            kinds = np.zeros((2, rows * side, columns * side), np.float32)
            for places, plane in zip(self.places, kinds, strict=True):
                if places.max() >= 0:
                    _place(places, blocks[frame], lapping_matrix(side), plane, touched)
            sums += [*kinds]
        result = picture.copy()
        _add(result, touched, self.blocks[0].shape[-1], face_area, *sums)
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
def _add(
    picture: Picture,
    touched: Mask,
    side: int,
    face_area: Single,
    luma: Single,
    fine_luma: Single,
    first: Single,
    fine_first: Single,
    second: Single,
    fine_second: Single,
) -> None:
    """Add luma and colour differences to a picture (h, w, 3), BGR, in the tiles that they touch.

    Those that are not of fine tiles are multiplied by 1 - `face_area`.
    """
    height, width = picture.shape[0], picture.shape[1]
    half, low, high = np.float32(0.5), np.float32(0), np.float32(255)
    per_weight = np.float32(1 / CHROMA_WEIGHT)
    for row in range(touched.shape[0]):
        for column in range(touched.shape[1]):
            if not touched[row, column]:
                continue
            for i in range(row * side, min((row + 1) * side, height)):
                for j in range(column * side, min((column + 1) * side, width)):
                    around = np.float32(1) - face_area[i, j]
                    y = around * luma[i, j] + fine_luma[i, j]
                    blue = around * first[i // 2, j // 2] + fine_first[i // 2, j // 2]
                    red = around * second[i // 2, j // 2] + fine_second[i // 2, j // 2]
                    blue, red = y + per_weight * blue, y + per_weight * red
                    green = (y - _BLUE * blue - _RED * red) / _GREEN
                    pixel = picture[i, j]
                    pixel[0] = np.uint8(min(max(pixel[0] + blue + half, low), high))
                    pixel[1] = np.uint8(min(max(pixel[1] + green + half, low), high))
                    pixel[2] = np.uint8(min(max(pixel[2] + red + half, low), high))
