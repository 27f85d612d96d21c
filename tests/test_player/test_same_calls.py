"""Player and decoder make the same of a call file: frames, models, pictures, damages."""

import random
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from call_contents import raw_packets
from call_kinds import CHANGED, ENCODED, MADE, SPEAKING, SmallCall, call_of_kind, encoded
from conftest import MakeOnce
from packet_integers import REFUSED, packet_integers
from played_integers import played_file
from player_process import check_same, of_player
from vector_contents import VECTORS

from benchmarks.fuzz.mutation import mutated
from protocol.call_file import MAGIC
from protocol.call_records import serialise_records
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    PacketKind,
    packet_kind,
    parse_packet,
    serialise,
)

VECTOR_CALLS = ("call_default", "call_layers", "call_residual", "call_thesis")
CHANGED_PACKETS = 8_000
PARTS_OF_CALLS = ("control_", "frame_", "layer", "model")
VECTOR_PACKETS = sorted(
    path.stem for path in VECTORS.glob("*.hex") if path.name.startswith(PARTS_OF_CALLS)
)


@pytest.fixture
def small_call(slow_clip: Path, live_call: Path, make_once: MakeOnce) -> SmallCall:
    """A call of a kind by its name."""
    return partial(call_of_kind, make_once, slow_clip, live_call)


@pytest.mark.parametrize("name", VECTOR_CALLS)
def test_calls_of_the_vectors(name: str, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    path.write_bytes(vector(name))
    played = played_file(path)
    assert played.ended and not played.damages
    check_same(path, played)


def test_packets_of_the_vectors(tmp_path: Path) -> None:
    """The pictures and profile data of their models are stand-ins."""
    found = check_same_packets([vector(name) for name in VECTOR_PACKETS], tmp_path)
    names = [PacketKind(fields[0]).name.lower() for fields in found]
    assert names == [name.partition("_")[0] for name in VECTOR_PACKETS]


@pytest.mark.parametrize(
    ("name", "model"), [("frame_thesis", "model"), ("frame_eyelids", "model_eyelids")]
)
def test_faces_of_the_vectors(name: str, model: str, tmp_path: Path) -> None:
    """A call of one frame packet."""
    frame, first = parse_packet(vector(name)), parse_packet(vector(model))
    assert isinstance(frame, FramePacket) and isinstance(first, ModelPacket)
    packets = (
        replace(first, sequence=frame.sequence),
        frame,
        ControlPacket(0, ControlKind.END, 1),
    )
    path = tmp_path / "call.rzo"
    path.write_bytes(MAGIC + serialise_records([serialise(each) for each in packets]))
    played = played_file(path)
    assert len(played.frames) == 1 and not played.damages
    check_same(path, played)


@pytest.mark.parametrize("name", ["call", "live_call", "recorded_call"])
def test_thesis_live_with_updates_and_recorded(name: str, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(name)
    played = played_file(path)
    assert len(played.frames) >= 25 and played.ended
    check_same(path, played)


@pytest.mark.parametrize("name", [*ENCODED, *SPEAKING, *MADE, *CHANGED])
def test_small_calls_of_all_kinds(name: str, small_call: SmallCall) -> None:
    path = small_call(name)
    played = played_file(path)
    assert len(played.frames) >= 5
    assert name == "damaged" or not played.damages
    check_same(path, played)


def test_a_real_clip(clips: Path, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    encoded(clips / "akiyo.mp4", path, {"max_frames": 17})
    check_same(path, played_file(path))


@pytest.mark.parametrize("seed", range(12))
def test_packets_that_no_encoder_makes(
    seed: int, live_call: Path, small_call: SmallCall, tmp_path: Path
) -> None:
    """Both refuse the same ones, and make the same of the rest."""
    source = random.Random(seed)
    call = small_call(source.choice(("picture residual", "voice of 700", "late layers", "thesis")))
    packets = raw_packets(live_call if seed < 3 else call)
    for _ in range(3):
        place = source.randrange(len(packets))
        packets[place] = mutated(source, [packets[place]]) or packets[place]
    path = tmp_path / "call.rzo"
    path.write_bytes(MAGIC + serialise_records(packets))
    check_same(path, played_file(path))


def test_changed_packets_are_the_same_or_refused_by_both(
    live_call: Path, call: Path, tmp_path: Path
) -> None:
    samples = [vector(name) for name in VECTOR_PACKETS]
    samples += [*raw_packets(live_call), *raw_packets(call)]
    others = [data for data in samples if packet_kind(data) is not PacketKind.FRAME]
    source = random.Random(2)
    packets = [mutated(source, others) for _ in range(CHANGED_PACKETS)]
    refused = sum(found[-1] == REFUSED for found in check_same_packets(packets, tmp_path))
    assert CHANGED_PACKETS / 10 < refused < CHANGED_PACKETS


def vector(name: str) -> bytes:
    return bytes.fromhex((VECTORS / f"{name}.hex").read_text())


def check_same_packets(packets: list[bytes], folder: Path) -> list[list[int]]:
    """What is in packets, the same in both."""
    path = folder / "packets.hex"
    path.write_text("".join(f"{data.hex()}\n" for data in packets))
    ours = [packet_integers(data) for data in packets]
    found: list[list[int]] = of_player([path])[0]
    for data, one, other in zip(packets, ours, found, strict=True):
        assert one == other, data.hex()
    return ours
