"""The block of a frame packet with the picture residual of its frames.

A block is its length (varint) and so many bytes, one range coder: the code of the step (6 bits),
then the tiles, see `tile_coding`.  A block of length 0 says that there is no residual.
"""

from dataclasses import dataclass

import numpy as np

from protocol.entropy.integer_codes import code_bits
from protocol.entropy.range_coder import RangeDecoder
from protocol.errors import ProtocolError
from protocol.limits import MAX_PICTURE_RESIDUAL_FRAMES, MAX_PICTURE_RESIDUAL_VALUES
from protocol.picture_residual.tile_coding import (
    LARGE_TILE,
    REGISTERS,
    SMALL_TILE,
    TileValues,
    code_tiles,
    initial_probabilities,
    side_of,
    values_of_tile,
)
from shared_model.arrays import Picture

# Pictures of so many pixels a side have small tiles: a face is a few tiles across.
MAX_SMALL_PX = 480
# The step doubles with every so many codes of it.
STEPS_PER_OCTAVE = 4
STEP_BITS = 6
# A decoded magnitude lies below its integer by so much, steps.
BIAS = 0.08
# Weight of the colour differences against luma.
CHROMA_WEIGHT = 0.5
_NO_DECISIONS = np.zeros((2, 0), np.int64)


@dataclass(frozen=True, slots=True)
class ResidualTiles:
    """The quantised residual of a group of frames.

    step_code: of the quantiser.
    flags: (rows, columns) uint8, 0: the tile has no values, 1: it has, 2: of half the step.
    values: (rows, columns, frames, `values_of_tile`) int16, in steps.
    """

    step_code: int
    flags: Picture
    values: TileValues

    @property
    def step(self) -> float:
        """The quantiser's step, grey levels."""
        return step_size(self.step_code)

    @property
    def side(self) -> int:
        """Side of a tile of luma."""
        return side_of(self.values.shape[-1])


@dataclass(frozen=True, slots=True)
class CodedResidual:
    """The picture residual of the source frames of a frame packet.

    data: not empty.  width, height: of the pictures, pixels.
    first, frames: the first source frame, and the number of them.
    """

    data: bytes
    width: int
    height: int
    first: int
    frames: int

    def parse(self) -> ResidualTiles:
        """The tiles.  Raises `ProtocolError` if the data is damaged."""
        return parse_tiles(self.data, self.width, self.height, self.frames)


def step_size(code: int) -> float:
    """The step of a code, grey levels."""
    return float(2 ** (code / STEPS_PER_OCTAVE))


def tile_side(width: int, height: int) -> int:
    """Side of the tiles of a picture."""
    return SMALL_TILE if max(width, height) <= MAX_SMALL_PX else LARGE_TILE


def tile_grid(width: int, height: int) -> tuple[int, int]:
    """Rows and columns of the tiles of a picture."""
    side = tile_side(width, height)
    return -(-height // side), -(-width // side)


def fits_limits(width: int, height: int, frames: int) -> bool:
    """Whether groups of so many pictures of this size may have a residual."""
    rows, columns = tile_grid(width, height)
    values = rows * columns * frames * values_of_tile(tile_side(width, height))
    return frames <= MAX_PICTURE_RESIDUAL_FRAMES and values <= MAX_PICTURE_RESIDUAL_VALUES


def parse_tiles(data: bytes, width: int, height: int, frames: int) -> ResidualTiles:
    """The residual in the bytes of a block that is not empty.

    Raises `ProtocolError` if they are none of `frames` pictures of this size.
    """
    if not fits_limits(width, height, frames):
        raise ProtocolError(f"picture residual of {frames} pictures of {width}x{height}")
    coder = RangeDecoder(data)
    step_code = code_bits(coder, 0, STEP_BITS)
    flags = np.zeros(tile_grid(width, height), np.uint8)
    of_tile = values_of_tile(tile_side(width, height))
    values = np.zeros((*flags.shape, frames, of_tile), np.int16)
    with coder.registers() as (read, own):
        registers = np.zeros(REGISTERS, np.int64)
        registers[:3] = own
        probabilities = initial_probabilities().copy()
        is_valid = code_tiles(read, registers, _NO_DECISIONS, probabilities, flags, values)
        own[:] = registers[:3]
    if not is_valid:
        raise ProtocolError("picture residual: a value is too large")
    if coder.unread_bytes:
        raise ProtocolError(f"picture residual: {coder.unread_bytes} bytes too many")
    return ResidualTiles(step_code, flags, values)
