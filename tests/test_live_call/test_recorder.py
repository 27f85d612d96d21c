"""A recording of a call that is under way: it begins with the model that its frames need."""

from dataclasses import replace
from pathlib import Path

import pytest
from layer_streams import BASE, frames

from protocol.call_file import CallReader
from protocol.packets import serialise
from risorius.live_call.messages import Recording
from risorius.live_call.packets.recorder import CallRecorder

MODEL = serialise(replace(BASE, version=0, version_count=1))
PACKETS = frames(6, model=replace(BASE, version=0, version_count=1))


@pytest.fixture
def told() -> list[Recording]:
    return []


@pytest.fixture
def recorder(told: list[Recording]) -> CallRecorder:
    return CallRecorder(told.append)


def recorded(path: Path) -> list[bytes]:
    with CallReader(path) as reader:
        return list(reader)


def test_a_recording_has_the_model_and_what_came_while_it_ran(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    for packet in (MODEL, *PACKETS[:2]):
        recorder.add(packet)
    recorder.record(path)
    for packet in PACKETS[2:4]:
        recorder.add(packet)
    assert told == [Recording(path)]
    recorder.close()
    recorder.add(PACKETS[4])
    assert recorded(path) == [MODEL, *PACKETS[2:4]]
    assert told == [Recording(path), Recording(None)]


def test_another_call_has_another_model(recorder: CallRecorder, tmp_path: Path) -> None:
    recorder.add(MODEL)
    recorder.forget()
    recorder.record(tmp_path / "call.rzo")
    recorder.add(PACKETS[0])
    recorder.close()
    assert recorded(tmp_path / "call.rzo") == [PACKETS[0]]


def test_each_call_has_a_file_of_its_own(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    recorder.record(tmp_path / "call.rzo")
    for _ in range(3):
        recorder.forget()
        for packet in (MODEL, *PACKETS[:2]):
            recorder.add(packet)
    recorder.forget()
    recorder.close()
    files = sorted(tmp_path.iterdir())
    assert [path.name for path in files] == ["call-2.rzo", "call-3.rzo", "call.rzo"]
    assert all(recorded(path) == [MODEL, *PACKETS[:2]] for path in files)
    assert {each.path for each in told} == {*files, None}


def test_what_is_no_packet_is_left_out(recorder: CallRecorder, tmp_path: Path) -> None:
    recorder.record(tmp_path / "call.rzo")
    recorder.add(MODEL[:1] + b"\xff" + MODEL[2:])
    recorder.add(MODEL)
    recorder.close()
    assert recorded(tmp_path / "call.rzo") == [MODEL]


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs /dev/full")
def test_a_full_disk_ends_the_recording_and_not_the_call(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    full = tmp_path / "call-2.rzo.part"
    full.symlink_to("/dev/full")
    recorder.record(tmp_path / "call.rzo")
    recorder.add(MODEL)
    recorder.forget()
    for packet in (MODEL, *PACKETS):
        recorder.add(packet)
    (reason,) = (each.reason for each in told if each.reason)
    assert "No space left" in reason and told[-1].path is None
    recorder.close()
    assert recorded(tmp_path / "call.rzo") == [MODEL]


def test_a_folder_that_is_gone_is_said(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    recorder.record(tmp_path / "none" / "call.rzo")
    recorder.add(MODEL)
    (recording,) = told
    assert recording.path is None and "there is no folder" in recording.reason
