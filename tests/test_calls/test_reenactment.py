"""Face reenactment: the motion of the source, the appearance of the target."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from call_files import call_file
from layer_streams import (
    FIRST,
    ITEMS,
    KNOWN,
    LEARNED,
    STREAM,
    WHOLE,
    expected,
    learned_layers,
    pieces,
)
from packets import MODEL
from videos import read_frames

from decoder.scene.reenactment import read_model, reenact
from protocol.call_file import MAGIC, CallReader
from protocol.call_records import serialise_records
from protocol.frames.scalar_quantiser import motion_from_pose
from protocol.frames.transform_coding import parse_transform
from protocol.limits import MAX_LAYER_BYTES
from protocol.model_packet import ModelPacket
from protocol.packets import (
    LayerPacket,
    Packet,
    PacketKind,
    packet_kind,
    parse_packet,
    serialise,
)
from protocol.summary import summarise
from risorius.cli import main
from shared_model.arrays import Array
from shared_model.geometry import FRONTAL, pose_from_euler
from shared_model.parameters import EAUS, FaceParameters

TARGET = replace(
    MODEL, reference_rotation=FRONTAL, reference_translation_mm=(-40.0, 10.0, 900.0), texture=b"x"
)


def face(modes: Array | None = None) -> FaceParameters:
    pose = pose_from_euler(4, -12, 3, np.array([30.0, -25.0, 640.0]))
    eau = np.linspace(0, 0.5, len(EAUS))
    return FaceParameters(pose, eau, np.zeros(0) if modes is None else modes)


def test_the_other_moves_from_their_own_reference_as_the_sender_does() -> None:
    sent = face()
    shown = reenact(sent, MODEL, TARGET)
    before = motion_from_pose(sent.pose, MODEL.reference_pose)
    after = motion_from_pose(shown.pose, TARGET.reference_pose)
    np.testing.assert_allclose(after, before, atol=1e-6)
    np.testing.assert_array_equal(shown.eau, sent.eau)


def test_the_sources_appearance_is_not_drawn() -> None:
    assert reenact(face(np.ones(4)), MODEL, TARGET).modes.size == 0


def test_a_callers_own_face_is_unchanged() -> None:
    sent = face(np.ones(4))
    assert reenact(sent, MODEL, replace(MODEL)) is sent


def test_decode_draws_another_caller_with_this_calls_frames(call: Path, tmp_path: Path) -> None:
    other, video = call_file(tmp_path / "other.rzo"), tmp_path / "out.mkv"
    assert main(["decode", str(call), "--face", str(other), "-o", str(video), "-q"]) == 0
    pictures = read_frames(video)
    # The other's picture size, green face and blue wall; the call's frames.
    assert len(pictures) == summarise(call).frames == 30
    assert pictures[0].shape == (120, 160, 3)
    assert pictures[0][60, 80].argmax() == 1 and pictures[0][3, 3].argmax() == 0
    assert any(not np.array_equal(pictures[0], later) for later in pictures[1:])


def test_a_face_that_is_none_is_one_line(
    call: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["decode", str(call), "--face", str(tmp_path / "none.rzo"), "-q"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_another_face_is_not_measured_against_the_source(
    call: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["decode", str(call), "--face", "a.rzo", "--source", "b.mp4"]) == 2
    assert "not allowed with" in capsys.readouterr().err


def test_the_layers_of_updates_are_not_applied_to_the_first_model(tmp_path: Path) -> None:
    path, more = tmp_path / "call.rzo", bytes(MAX_LAYER_BYTES)
    packets: list[Packet] = [FIRST, *pieces(STREAM, [20])]
    packets[1:1] = [LayerPacket(FIRST.version + 1, number, more) for number in range(40)]
    path.write_bytes(MAGIC + serialise_records(serialise(packet) for packet in packets))
    assert read_model(path) == expected(len(ITEMS))


@pytest.mark.parametrize("layered", [False, True])
def test_the_newest_model_of_a_call_is_drawn_with_its_layers(layered: bool, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    rough = replace(FIRST, version=FIRST.version - 1, texture=b"rougher")
    update = FIRST if layered else replace(FIRST, progressive=False)
    layers = pieces(STREAM, [20]) if layered else []
    packets: list[Packet] = [rough, LayerPacket(rough.version, 0, bytes(9)), *layers, update, rough]
    path.write_bytes(MAGIC + serialise_records(serialise(packet) for packet in packets))
    assert read_model(path) == (expected(len(ITEMS)) if layered else update)


def test_a_newest_model_without_a_background_wears_the_newest_before_it(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    models = [
        replace(MODEL, version=n, version_count=4, background=b"still %d" % n) for n in range(3)
    ]
    bare = replace(MODEL, version=3, version_count=4, background=b"")
    # The first is repeated for who joins late.
    for newest, background in ((bare, b"still 2"), (replace(bare, background=b"own"), b"own")):
        packets = [*models, newest, models[0]]
        path.write_bytes(MAGIC + serialise_records(serialise(packet) for packet in packets))
        assert read_model(path) == replace(newest, background=background)


def test_reserved_modes_of_a_call_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    packets: list[Packet] = [WHOLE, *learned_layers(*LEARNED)]
    path.write_bytes(MAGIC + serialise_records(serialise(packet) for packet in packets))
    worn = read_model(path)
    assert parse_transform(worn.profile_data).modes == (*KNOWN, *LEARNED, b"")
    sent = face(np.ones(5))
    assert reenact(sent, WHOLE, worn) is sent


def test_the_calls_own_file_as_its_face_changes_nothing(call: Path, tmp_path: Path) -> None:
    with CallReader(call) as reader:
        packets = [parse_packet(data) for data in reader if packet_kind(data) is PacketKind.MODEL]
    assert packets and isinstance(packets[0], ModelPacket)
    plain, same = tmp_path / "plain.mkv", tmp_path / "same.mkv"
    assert main(["decode", str(call), "-o", str(plain), "-q"]) == 0
    assert main(["decode", str(call), "--face", str(call), "-o", str(same), "-q"]) == 0
    for a, b in zip(read_frames(plain), read_frames(same), strict=True):
        np.testing.assert_array_equal(a, b)
