"""The test vector of a call with a picture residual; see `make_vectors`."""

from dataclasses import replace
from typing import Any

import numpy as np

from encoder.residual.residual_encoder import serialise_tiles
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, parse_packet, serialise
from protocol.picture_residual.framing import covered_frames, join_payload, split_payload
from protocol.picture_residual.inverse_transform import ResidualPictures
from protocol.picture_residual.residual_block import CodedResidual, ResidualTiles, tile_grid
from protocol.picture_residual.tile_coding import SMALL_TILE, values_of_tile

# Coded frames of the frame packets of the call.
CODED_FRAMES = 1, 4


def tiles_of(width: int, height: int, frames: int, seed: int) -> ResidualTiles:
    """Tiles with few values, one of them with an escape code."""
    rng = np.random.default_rng(seed)
    flags = rng.integers(0, 3, tile_grid(width, height)).astype(np.uint8)
    shape = (*flags.shape, frames, values_of_tile(SMALL_TILE))
    values = np.rint(rng.laplace(0, 2, shape) * (rng.random(shape) < 0.02)).astype(np.int16)
    values[flags == 0] = 0
    values[*np.argwhere(flags)[0], 0, 0] = -33
    flags[~values.any((2, 3))] = 0
    return ResidualTiles(18 + seed, flags, values)


def with_residuals(packets: list[bytes]) -> list[bytes]:
    """A call of one model whose frame packets have residuals; the first one is empty."""
    result, number = list[bytes](), 0
    for data in packets:
        packet = parse_packet(data)
        if isinstance(packet, ModelPacket):
            call = packet.call
            packet = replace(packet, call=replace(call, has_residual=True))
        elif isinstance(packet, FramePacket):
            frames = len(covered_frames(call, number, CODED_FRAMES[number]))
            tiles = tiles_of(call.width, call.height, frames, number)
            block = serialise_tiles(tiles) if number else b""
            packet = FramePacket(packet.sequence, join_payload(block, packet.payload))
            number += 1
        result.append(serialise(packet))
    return result


def decoded_residuals(packets: list[bytes]) -> list[dict[str, Any]]:
    """What a decoder finds in the blocks that are not empty: of pictures the middle row."""
    found, number = list[dict[str, Any]](), 0
    for data in packets:
        packet = parse_packet(data)
        if isinstance(packet, ModelPacket):
            call = packet.call
        elif isinstance(packet, FramePacket):
            covered = covered_frames(call, number, CODED_FRAMES[number])
            number += 1
            block, _ = split_payload(packet.payload)
            if not block:
                continue
            coded = CodedResidual(
                block, call.width, call.height, covered.start, len(covered)
            ).parse()
            pictures = ResidualPictures.from_tiles(coded)
            grey = np.full((call.height, call.width, 3), 128, np.uint8)
            # The face is to the left.
            area = np.zeros(grey.shape[:2], np.float32)
            area[:, : call.width // 2] = 1
            found.append(
                {
                    "first": covered.start,
                    "step_code": coded.step_code,
                    "flags": coded.flags.tolist(),
                    "values": [
                        [*map(int, place), int(coded.values[tuple(place)])]
                        for place in np.argwhere(coded.values)
                    ],
                    "on_grey": [
                        pictures.add_to(grey, frame, area)[call.height // 2].tolist()
                        for frame in range(len(covered))
                    ],
                }
            )
    return found
