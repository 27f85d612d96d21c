"""The bytes of a quantised picture residual."""

import numpy as np

from encoder.picture_coding.symbol_writing import DecisionRecorder, Decisions, range_coded
from protocol.entropy.integer_codes import code_bits
from protocol.picture_residual.residual_block import STEP_BITS, ResidualTiles
from protocol.picture_residual.tile_coding import (
    REGISTERS,
    code_tiles,
    initial_probabilities,
)

_NOTHING = np.zeros(0, np.uint8)


def serialise_tiles(tiles: ResidualTiles) -> bytes:
    """The bytes of a block, see `residual_block`; empty if no tile has values."""
    if not tiles.flags.any():
        return b""
    header = DecisionRecorder()
    code_bits(header, tiles.step_code, STEP_BITS)
    return range_coded([header.recorded(), tile_decisions(tiles)])


def tile_decisions(tiles: ResidualTiles) -> Decisions:
    """The decisions that code the tiles."""
    registers = np.zeros(REGISTERS, np.int64)
    registers[-1] = 1
    decisions = np.zeros((2, _most_decisions(tiles)), np.int64)
    probabilities = initial_probabilities().copy()
    flags, values = tiles.flags.copy(), tiles.values.copy()
    code_tiles(_NOTHING, registers, decisions, probabilities, flags, values)
    bits, zeros = decisions[:, : registers[-2]]
    return bits, zeros


def _most_decisions(tiles: ResidualTiles) -> int:
    """No fewer than the decisions of the tiles."""
    coded = tiles.values[tiles.flags > 0]
    of_values = int(np.minimum(np.abs(coded.astype(np.int64)), 48).sum()) + 2 * coded.size
    return 2 * int(tiles.flags.size) + of_values + 32 * int(coded.shape[1]) * len(coded) + 64
