"""Pictures of differences -> values of tiles, see `protocol.picture_residual.block_transform`."""

from collections.abc import Sequence

import cv2
import numpy as np

from protocol.picture_residual.block_transform import dct_matrix, lapping_matrix
from protocol.picture_residual.residual_block import CHROMA_WEIGHT
from protocol.picture_residual.tile_coding import plane_start, values_of_tile
from protocol.pictures.picture_codec import LUMA_BGR
from shared_model.arrays import Single

_LUMA = np.array(LUMA_BGR, np.float32)
# Luma and weighted colour differences of blue, green and red.
_PLANES = np.stack(
    [_LUMA, CHROMA_WEIGHT * ([1, 0, 0] - _LUMA), CHROMA_WEIGHT * ([0, 0, 1] - _LUMA)]
).astype(np.float32)


def forward_transform(differences: Sequence[Single], tile: int) -> Single:
    """(rows, columns, frames, values) of the tiles of differences, (h, w, 3) each.

    differences: BGR, source less drawn picture.  tile: their side, pixels.
    """
    (height, width), frames = differences[0].shape[:2], len(differences)
    rows, columns = -(-height // tile), -(-width // tile)
    below, right = rows * tile - height, columns * tile - width
    planes = [np.empty((frames, rows * tile, columns * tile), np.float32)]
    planes += [np.empty((frames, rows * tile // 2, columns * tile // 2), np.float32) for _ in "br"]
    for frame, difference in enumerate(differences):
        coloured = cv2.transform(difference, _PLANES)
        padded = cv2.copyMakeBorder(coloured, 0, below, 0, right, cv2.BORDER_REPLICATE)
        halved = cv2.resize(padded, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        planes[0][frame] = padded[..., 0]
        planes[1][frame], planes[2][frame] = halved[..., 1], halved[..., 2]
    values = np.empty((rows, columns, frames, values_of_tile(tile)), np.float32)
    for plane, samples in enumerate(planes):
        side, start = tile // 2 if plane else tile, plane_start(plane, tile)
        blocks = _transformed(samples, side)
        values[..., start : start + side**2] = blocks.reshape(rows, columns, frames, side**2)
    return values


def _transformed(samples: Single, side: int) -> Single:
    """(rows, columns, frames, side, side) values of the blocks of a plane (frames, h, w)."""
    frames = len(samples)
    dct = dct_matrix(side)
    flat = (dct_matrix(frames) @ samples.reshape(frames, -1)).reshape(samples.shape)
    by_rows = dct @ _lapped(flat, side).reshape(frames, -1, side, samples.shape[2])
    columns = np.ascontiguousarray(by_rows.reshape(frames, -1, samples.shape[2]).swapaxes(1, 2))
    blocks = dct @ _lapped(columns, side).reshape(frames, -1, side, samples.shape[1])
    # Frames, columns of blocks, column, rows of blocks, row.
    apart = blocks.reshape(frames, -1, side, samples.shape[1] // side, side)
    return np.asarray(apart.transpose(3, 1, 0, 4, 2), np.float32)


def _lapped(samples: Single, side: int) -> Single:
    """Samples (frames, n * side, m), filtered across the borders of blocks of rows."""
    half, frames, rows, across = side // 2, *samples.shape
    count = rows // side - 1
    if not count:
        return samples
    result = samples.copy()
    inner = samples[:, half : half + count * side].reshape(frames, count, side, across)
    filtered = lapping_matrix(side) @ inner
    result[:, half : half + count * side] = filtered.reshape(frames, count * side, across)
    return result
