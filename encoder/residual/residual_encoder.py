"""Codes the picture residual of a call, packet by packet, in the bits that the faces leave."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from encoder.coding.model_packet import USUAL_UP_TO_BPS
from encoder.coding.rate_control import RESERVOIR_S
from encoder.picture_coding.quantiser_search import finest_quantiser_within
from encoder.picture_coding.symbol_writing import DecisionRecorder, Decisions, range_coded
from encoder.residual.face_filling import face_filled
from encoder.residual.forward_transform import forward_transform
from encoder.residual.quantiser import quantise_tiles
from protocol.entropy.integer_codes import code_bits
from protocol.entropy.varint import encode_varint
from protocol.limits import MAX_FRAME_PAYLOAD_BYTES
from protocol.model_packet import ModelPacket
from protocol.picture_residual.residual_block import (
    STEP_BITS,
    ResidualTiles,
    fits_limits,
    step_size,
    tile_grid,
    tile_side,
)
from protocol.picture_residual.tile_coding import (
    REGISTERS,
    code_tiles,
    initial_probabilities,
    plane_start,
    side_of,
)
from shared_model.arrays import Mask, Single

# Below this rate all bits are the faces'; above it they have so much, and this share of the rest.
FACES_ALONE_BPS, FACES_SHARE = USUAL_UP_TO_BPS, 0.5
# A packet may take what it earns and this share of what those before have left.
SAVED_SHARE = 0.3
# A tile is fine if this share of it is face.
FACE_SHARE = 0.7
# Where the luma of a face is further off than this, squared grey levels (35 dB), something is
# before it, a hand, which people look at first: bits around the face cost more by this power of the
# ratio, at most so much.
USUAL_FACE_ERROR, PRICE_POWER, MOST_PRICE = 20.0, 1.5, 16.0
# Codes of the step: the finest, the one tried first, the coarsest; and in how many bits halve.
FINEST, INITIAL, COARSEST = 8, 32, 44
CODES_PER_HALVING = 2.5
_NOTHING = np.zeros(0, np.uint8)


def faces_bitrate(bitrate: float) -> float:
    """The bits a second of a call's faces, where the rest is for the residual."""
    return min(bitrate, FACES_ALONE_BPS + FACES_SHARE * (bitrate - FACES_ALONE_BPS))


def has_residual(bitrate: float, size: tuple[int, int], packet_frames: int) -> bool:
    """Whether a call has bits for a residual, and pictures of (width, height) that may have one.

    packet_frames: source frames of a packet.
    """
    return bitrate > FACES_ALONE_BPS and fits_limits(*size, packet_frames)


def spent_bits(face: bytes) -> int:
    """The bits of a packet without its residual: its faces, and two bytes of its record."""
    return 8 * (len(face) + 2)


def with_residual_stated(packet: ModelPacket) -> ModelPacket:
    """The model packet of a call whose frame packets have residuals."""
    return replace(packet, call=replace(packet.call, has_residual=True))


class ResidualEncoder:
    """Codes groups of pictures of (width, height) at the rate of a call.

    bitrate: of frame packets, bits a second.
    """

    def __init__(self, bitrate: float, width: int, height: int) -> None:
        self._bitrate, self._size = bitrate, (width, height)
        self._saved, self._newest_bits = 0.0, 0
        self._code = INITIAL

    def encode(
        self,
        differences: Sequence[Single],
        face_areas: Sequence[Single],
        seconds: float,
        faces_bits: float,
    ) -> bytes:
        """The residual of a packet; empty: it has none.

        differences: (h, w, 3) BGR of each source frame, source less drawn picture.
        face_areas: (h, w) of each, see `DrawnPicture`: what is coded more finely.
        seconds: of the call.  faces_bits: what the packet has besides.
        """
        earned = self._bitrate * seconds - faces_bits
        self._saved = min(self._saved + earned, self._bitrate * RESERVOIR_S)
        limit = min(max(earned, 0.0) + SAVED_SHARE * self._saved, self._saved)
        limit = min(limit, 8 * (MAX_FRAME_PAYLOAD_BYTES // 2))
        self._newest_bits = 0
        if limit < 8:
            return b""
        is_fine = _tiles_within(np.mean(face_areas, axis=0), *self._size)
        tile = tile_side(*self._size)
        around = [
            face_filled(difference, area, tile)
            for difference, area in zip(differences, face_areas, strict=True)
        ]
        values = forward_transform(around, tile)
        if is_fine.any():
            self._put_face(values, differences, is_fine)
        price = price_around(values, is_fine)

        def code(step_code: int) -> bytes:
            quantised = quantise_tiles(values, step_size(step_code), is_fine, price)
            return serialise_tiles(ResidualTiles(step_code, *quantised))

        codes = range(FINEST, COARSEST + 1)
        self._code, data = finest_quantiser_within(
            code, _bits_of, limit, codes, self._code, CODES_PER_HALVING
        )
        if _bits_of(data) > limit:
            data = b""
        self._newest_bits = _bits_of(data)
        self._saved -= self._newest_bits
        return data

    def take_back(self) -> None:
        """What was encoded last has not been sent."""
        self._saved, self._newest_bits = self._saved + self._newest_bits, 0

    def _put_face(self, values: Single, differences: Sequence[Single], is_fine: Mask) -> None:
        """Write the values of the tiles `is_fine`, of what is not continued into the face."""
        side = tile_side(*self._size)
        rows, columns = (np.flatnonzero(is_fine.any(axis)) for axis in (1, 0))
        # A block reaches half a block into its neighbours.
        top, left = max(rows[0] - 1, 0), max(columns[0] - 1, 0)
        window = slice(top, rows[-1] + 2), slice(left, columns[-1] + 2)
        pixels = tuple(slice(side * each.start, side * each.stop) for each in window)
        of_face = forward_transform([each[pixels] for each in differences], side)
        values[window][is_fine[window]] = of_face[is_fine[window]]


def price_around(values: Single, is_fine: Mask) -> float:
    """How many times as much a bit around the face must gain as one in it.

    values: (rows, columns, frames, `values_of_tile`).  is_fine: (rows, columns) tiles of the face.
    """
    if not is_fine.any():
        return 1.0
    luma = values[is_fine][..., : plane_start(1, side_of(values.shape[-1]))]
    error = float(np.mean(luma**2))
    return float(np.clip((error / USUAL_FACE_ERROR) ** PRICE_POWER, 1.0, MOST_PRICE))


def _bits_of(data: bytes) -> int:
    return 8 * (len(encode_varint(len(data))) + len(data))


def _tiles_within(face_area: Single, width: int, height: int) -> Mask:
    """(rows, columns) the tiles that are in a face, or more in it than not."""
    (rows, columns), side = tile_grid(width, height), tile_side(width, height)
    whole = np.zeros((rows * side, columns * side), np.float32)
    whole[:height, :width] = face_area
    share = whole.reshape(rows, side, columns, side).mean((1, 3))
    return np.asarray(share > FACE_SHARE)


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
