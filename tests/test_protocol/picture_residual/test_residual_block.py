"""Blocks of the picture residual: what is written is read; anything else is refused."""

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packets import VECTORS

from encoder.residual.residual_encoder import serialise_tiles
from protocol.bit_accounting import BitAccounting
from protocol.call_file import CallReader
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.limits import MAX_PICTURE_RESIDUAL_FRAMES
from protocol.packets import FramePacket, parse_packet
from protocol.picture_residual.framing import covered_frames, join_payload, split_payload
from protocol.picture_residual.residual_block import (
    CodedResidual,
    ResidualTiles,
    parse_tiles,
    tile_grid,
)
from protocol.picture_residual.tile_coding import SMALL_TILE, values_of_tile

WIDTH, HEIGHT = 70, 33


def tiles(seed: int, frames: int, density: float, size: float) -> ResidualTiles:
    """Some tiles with some values; magnitudes are about `size`, some far larger."""
    rng = np.random.default_rng(seed)
    flags = rng.integers(0, 3, tile_grid(WIDTH, HEIGHT)).astype(np.uint8)
    shape = (*flags.shape, frames, values_of_tile(SMALL_TILE))
    values = np.rint(rng.laplace(0, size, shape) * (rng.random(shape) < density)).astype(np.int16)
    values[rng.random(shape) < 1e-4] = -9000
    values[flags == 0] = 0
    flags[~values.any((2, 3))] = 0
    return ResidualTiles(int(rng.integers(0, 64)), flags, values)


@pytest.mark.parametrize("frames", [1, 3, 8, 16])
@pytest.mark.parametrize(("density", "size"), [(0.002, 1.0), (0.1, 3.0), (1.0, 40.0)])
def test_what_is_written_is_read(frames: int, density: float, size: float) -> None:
    written = tiles(frames, frames, density, size)
    read = parse_tiles(serialise_tiles(written), WIDTH, HEIGHT, frames)
    assert read.step_code == written.step_code
    np.testing.assert_array_equal(read.flags, written.flags)
    np.testing.assert_array_equal(read.values, written.values)


def test_nothing_takes_no_bytes() -> None:
    empty = ResidualTiles(
        9, np.zeros((3, 5), np.uint8), np.zeros((3, 5, 8, values_of_tile(SMALL_TILE)), np.int16)
    )
    assert serialise_tiles(empty) == b""


@given(st.binary(max_size=300))
def test_any_bytes_are_tiles_or_refused(data: bytes) -> None:
    try:
        found = parse_tiles(data, WIDTH, HEIGHT, 8)
    except ProtocolError:
        return
    assert found.flags.shape == tile_grid(WIDTH, HEIGHT)


def test_a_value_beyond_the_largest_is_refused() -> None:
    with pytest.raises(ProtocolError, match="a value is too large"):
        parse_tiles(b"\xff" * 300, WIDTH, HEIGHT, 8)


def test_bytes_behind_the_last_decision_are_refused() -> None:
    data = serialise_tiles(tiles(1, 8, 0.01, 2.0))
    with pytest.raises(ProtocolError, match="bytes too many"):
        parse_tiles(data + b"\xff\xfe\xfd\xfc" + b"\x01" * 6, WIDTH, HEIGHT, 8)


@pytest.mark.parametrize(
    ("size", "frames"), [((70, 33), MAX_PICTURE_RESIDUAL_FRAMES + 1), ((8192, 8192), 8)]
)
def test_what_would_take_too_much_memory_is_refused(size: tuple[int, int], frames: int) -> None:
    with pytest.raises(ProtocolError, match="picture residual of"):
        CodedResidual(b"\x10", *size, 0, frames).parse()


@given(st.binary(max_size=200), st.binary(max_size=50))
def test_payloads_are_split_as_they_were_joined(block: bytes, face: bytes) -> None:
    assert split_payload(join_payload(block, face)) == (block, face)


@pytest.mark.parametrize("payload", [b"", b"\x05abc", b"\xff"])
def test_a_block_that_is_cut_is_refused(payload: bytes) -> None:
    with pytest.raises(ProtocolError, match="picture residual"):
        split_payload(payload)


def test_packets_cover_every_source_frame_once() -> None:
    call = CallParameters(
        "default", 64, 48, 60, 1, 80.0, frames_per_packet=8, start_frame=5, frame_step=2
    )
    covered = [covered_frames(call, number, 8 if number else 1) for number in range(3)]
    assert covered == [range(5, 6), range(6, 22), range(22, 38)]
    assert covered_frames(call, 3, 2) == range(38, 42)


def test_the_thesis_profile_has_none() -> None:
    with pytest.raises(ValueError, match="thesis profile has no picture residual"):
        CallParameters("thesis", 64, 48, 25, 1, 80.0, has_residual=True)


def test_bytes_of_the_residual_are_counted_apart() -> None:
    accounting, payload = BitAccounting(), 0
    digits = (VECTORS / "call_residual.hex").read_text()
    for data in CallReader(BytesIO(bytes.fromhex(digits))):
        packet = parse_packet(data)
        accounting.add(packet)
        if isinstance(packet, FramePacket):
            payload += len(packet.payload)
    groups = accounting.groups
    assert sum(groups.values()) == pytest.approx(payload)
    assert groups["residual"] > groups["pose"] > 0
