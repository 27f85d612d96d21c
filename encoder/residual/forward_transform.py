"""Pictures of differences -> values of tiles, see `protocol.picture_residual.block_transform`."""

import numpy as np

from protocol.picture_residual.block_transform import dct_matrix, lapping_matrix
from protocol.picture_residual.residual_block import tile_grid, tile_side
from protocol.picture_residual.tile_coding import plane_start, values_of_tile
from protocol.pictures.picture_codec import to_planes
from shared_model.arrays import Single


def forward_transform(differences: Single, chroma_weight: float) -> Single:
    """(rows, columns, frames, values) of the tiles of differences (frames, h, w, 3).

    differences: BGR, source less drawn picture.  chroma_weight: see `to_planes`.
    """
    frames, height, width = differences.shape[:3]
    (rows, columns), tile = tile_grid(width, height), tile_side(width, height)
    planes = to_planes(differences, chroma_weight)
    padding = [(0, 0), (0, rows * tile - height), (0, columns * tile - width), (0, 0)]
    planes = np.pad(planes, padding, mode="edge")
    values = np.empty((rows, columns, frames, values_of_tile(tile)), np.float32)
    for plane in range(3):
        side, samples = tile, planes[..., plane]
        if plane:
            side = tile // 2
            halved = samples.reshape(frames, rows * side, 2, columns * side, 2)
            samples = halved.mean((2, 4))
        blocks = _transformed(np.ascontiguousarray(samples), side)
        start = plane_start(plane, tile)
        values[..., start : start + side**2] = blocks.reshape(rows, columns, frames, side**2)
    return values


def _transformed(samples: Single, side: int) -> Single:
    """(rows, columns, frames, side, side) values of the blocks of a plane (frames, h, w)."""
    frames = len(samples)
    dct = dct_matrix(side)
    lapped = _lapped(_lapped(samples, side).swapaxes(1, 2), side)  # columns come first
    columns, rows = lapped.shape[1] // side, lapped.shape[2] // side
    across = dct @ lapped.reshape(frames, columns, side, rows * side)
    by_rows = across.reshape(frames, columns, side, rows, side) @ dct.T
    flat = by_rows.reshape(frames, -1)
    in_time = (dct_matrix(frames) @ flat).reshape(frames, columns, side, rows, side)
    return np.asarray(in_time.transpose(3, 1, 0, 4, 2), np.float32)


def _lapped(samples: Single, side: int) -> Single:
    """Samples (frames, n * side, m), filtered across the borders of blocks of rows."""
    half, result = side // 2, samples.copy()
    count = samples.shape[1] // side - 1
    if count:
        inner = samples[:, half : half + count * side].reshape(len(samples), count, side, -1)
        result[:, half : half + count * side] = (lapping_matrix(side) @ inner).reshape(
            len(samples), count * side, -1
        )
    return result
