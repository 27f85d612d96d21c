"""Player and decoder make the same of a call file: frames, models, pictures, damages."""

import random
from functools import partial
from pathlib import Path

import pytest
from call_contents import raw_packets
from call_kinds import CHANGED, ENCODED, MADE, SPEAKING, SmallCall, call_of_kind, encoded
from conftest import MakeOnce
from played_integers import played_file
from player_process import check_same, of_player
from vector_contents import VECTORS

from benchmarks.fuzz.mutation import mutated
from decoder.playout.frame_decoder import frame_decoder_for
from protocol.call_file import MAGIC
from protocol.call_records import serialise_records
from protocol.errors import ProtocolError
from protocol.model_packet import ModelPacket
from protocol.packets import PacketKind, packet_kind, parse_packet

VECTOR_CALLS = ("call_default", "call_layers", "call_residual", "call_thesis")
CHANGED_PACKETS = 8_000
PARTS_OF_CALLS = ("control", "layer", "model")


@pytest.fixture
def small_call(slow_clip: Path, live_call: Path, make_once: MakeOnce) -> SmallCall:
    """A call of a kind by its name."""
    return partial(call_of_kind, make_once, slow_clip, live_call)


@pytest.mark.parametrize("name", VECTOR_CALLS)
def test_calls_of_the_vectors(name: str, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    path.write_bytes(bytes.fromhex((VECTORS / f"{name}.hex").read_text()))
    played = played_file(path)
    assert played.ended and not played.damages
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


def test_changed_packets_are_refused_by_both(live_call: Path, call: Path, tmp_path: Path) -> None:
    vectors = [path for path in VECTORS.glob("*.hex") if path.name.startswith(PARTS_OF_CALLS)]
    samples = [bytes.fromhex(path.read_text()) for path in vectors]
    samples += [*raw_packets(live_call), *raw_packets(call)]
    others = [data for data in samples if packet_kind(data) is not PacketKind.FRAME]
    source = random.Random(2)
    packets = [mutated(source, others) for _ in range(CHANGED_PACKETS)]
    path = tmp_path / "packets.hex"
    path.write_text("".join(f"{data.hex()}\n" for data in packets))
    ours = [is_refused(data) for data in packets]
    found: list[bool] = of_player([path])[0]
    differing = [i for i, is_ours in enumerate(ours) if found[i] != is_ours]
    assert not differing, packets[differing[0]].hex()
    assert CHANGED_PACKETS / 10 < sum(ours) < CHANGED_PACKETS


def is_refused(data: bytes) -> bool:
    try:
        packet = parse_packet(data)
        if isinstance(packet, ModelPacket):
            frame_decoder_for(packet)
    except ProtocolError:
        return True
    return False
