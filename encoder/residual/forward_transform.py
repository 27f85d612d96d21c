"""Pictures of differences -> values of tiles, see `protocol.picture_residual.block_transform`."""

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from protocol.picture_residual.block_transform import dct_matrix, lapping_matrix
from protocol.picture_residual.residual_block import CHROMA_WEIGHT
from protocol.picture_residual.tile_coding import plane_start, values_of_tile
from protocol.pictures.picture_codec import LUMA_BGR
from shared_model.arrays import Single

_LUMA = np.array([LUMA_BGR], np.float32)
# Weighted colour differences of blue and red.
_CHROMA = np.asarray(CHROMA_WEIGHT * (np.array([[1, 0, 0], [0, 0, 1]]) - _LUMA), np.float32)


def forward_transform(differences: Sequence[Single], tile: int) -> Single:
    """(rows, columns, frames, values) of the tiles of differences, (h, w, 3) each.

    differences: BGR, source less drawn picture.  tile: their side, pixels.
    """
    (height, width), frames = differences[0].shape[:2], len(differences)
    rows, columns = -(-height // tile), -(-width // tile)
    sides = tile, tile // 2, tile // 2
    planes = [
        np.zeros((frames, (rows + 1) * side, (columns + 1) * side), np.float32) for side in sides
    ]
    for frame, difference in enumerate(differences):
        for plane, side, samples in zip(planes, sides, _coloured(difference, tile), strict=True):
            half = side // 2
            plane[frame, half:-half, half:-half] = samples
    values = np.empty((rows, columns, frames, values_of_tile(tile)), np.float32)
    for index, (plane, side) in enumerate(zip(planes, sides, strict=True)):
        start = plane_start(index, tile)
        # A view: the last axis alone is split.
        own = values[..., start : start + side**2].reshape(rows, columns, frames, side, side)
        _transform(plane, side, own)
    return values


def _coloured(difference: Single, tile: int) -> tuple[Single, Single, Single]:
    """Luma, and both colour differences at half the size, of whole tiles."""
    height, width = difference.shape[:2]
    below, right = -height % tile, -width % tile
    whole = cv2.copyMakeBorder(difference, 0, below, 0, right, cv2.BORDER_REPLICATE)
    halved = cv2.resize(whole, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    chroma = np.asarray(cv2.transform(halved, _CHROMA), np.float32)
    luma = np.asarray(cv2.transform(whole, _LUMA), np.float32)
    return luma, chroma[..., 0], chroma[..., 1]


def _transform(plane: Single, side: int, values: Single) -> None:
    """Write the values (rows, columns, frames, side, side) of the blocks of a plane.

    plane: (frames, h, w) with half a block of zeros around.
    """
    rows, columns, frames = values.shape[:3]
    in_time = (dct_matrix(frames) @ plane.reshape(frames, -1)).reshape(plane.shape)
    # Of a row of blocks alone, so that all of it stays in a cache.
    lines = np.empty((frames, side, plane.shape[2]), np.float32)
    # Columns of blocks, frames and lines, samples that a block needs.
    beside = sliding_window_view(lines.reshape(frames * side, -1), 2 * side, 1)
    beside = beside[:, ::side].swapaxes(0, 1)
    blocks = np.empty((columns, frames * side, side), np.float32)
    ends = [(i, _block_matrix(side, i == 0, i == columns - 1).T) for i in {0, columns - 1}]
    between, inner = slice(1, columns - 1), _block_matrix(side, False, False).T
    for row in range(rows):
        above = in_time[:, row * side : (row + 2) * side]
        np.matmul(_block_matrix(side, row == 0, row == rows - 1), above, out=lines)
        for column, matrix in ends:
            np.matmul(beside[column], matrix, out=blocks[column])
        np.matmul(beside[between], inner, out=blocks[between])
        values[row] = blocks.reshape(columns, frames, side, side)


@cache
def _block_matrix(side: int, is_first: bool, is_last: bool) -> Single:
    """(side, 2 * side) a block's values from its samples and half a block on either side of it.

    is_first, is_last: nothing is before, after it.
    """
    half, lapping = side // 2, lapping_matrix(side)
    lapped = np.zeros((side, 2 * side), np.float32)
    if is_first:
        lapped[:half, half:side] = np.eye(half)
    else:
        lapped[:half, :side] = lapping[half:]
    if is_last:
        lapped[half:, side:-half] = np.eye(half)
    else:
        lapped[half:, side:] = lapping[:half]
    return np.asarray(dct_matrix(side) @ lapped, np.float32)
