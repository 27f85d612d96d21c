"""The recorder of a call: its files, what ends them, and what is told of them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from layer_streams import PACKED
from recordings import (
    MODEL,
    PACKETS,
    check_whole,
    control,
    first_frame,
    record_part,
    recorded,
)

from decoder.pipeline import DecodeOptions, decode
from protocol.packets import (
    ControlKind,
)
from risorius.call_info import call_info
from risorius.live_call.messages import Recording
from risorius.live_call.packets.recorder import CallRecorder


@pytest.fixture
def told() -> list[Recording]:
    return []


@pytest.fixture
def recorder(told: list[Recording]) -> CallRecorder:
    return CallRecorder(told.append)


def test_a_recording_has_the_model_what_came_while_it_ran_and_an_end(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    for packet in (MODEL, *PACKETS[:2]):
        recorder.add(packet)
    recorder.record(path)
    assert told == [Recording(path)]
    for packet in PACKETS[2:4]:
        recorder.add(packet)
    recorder.close()
    recorder.add(PACKETS[4])
    joined, end = control(ControlKind.JOINED, 1 + PACKED), control(ControlKind.END, 2 * PACKED)
    assert recorded(path) == [MODEL, joined, *PACKETS[2:4], end]
    assert told == [Recording(path), Recording(None)]


def test_a_call_that_is_recorded_whole_is_what_was_sent(live_call: Path, tmp_path: Path) -> None:
    path, packets = tmp_path / "call.rzo", recorded(live_call)
    record_part(path, packets, 0, len(packets) + 1)
    assert path.read_bytes() == live_call.read_bytes()


def test_an_encoder_that_starts_again_has_a_file_of_its_own(
    recorder: CallRecorder, tmp_path: Path
) -> None:
    recorder.add(MODEL, 0)
    recorder.record(tmp_path / "call.rzo")
    for session in (0, 1):
        recorder.add(MODEL, 0, session)
        for number, packet in enumerate(PACKETS[: 3 + session]):
            recorder.add(packet, number, session)
    recorder.add(PACKETS[5], 5, 0)
    recorder.close()
    assert check_whole(tmp_path / "call.rzo") == range(first_frame(3))
    assert check_whole(tmp_path / "call-2.rzo") == range(first_frame(4))


def test_a_call_without_its_model_is_not_recorded(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    recorder.add(MODEL)
    recorder.forget()
    recorder.record(tmp_path / "call.rzo")
    recorder.add(PACKETS[0])
    recorder.close()
    assert not list(tmp_path.iterdir())
    assert told[-1].path is None and "no face came" in told[-1].reason


def test_each_call_has_a_file_of_its_own(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    recorder.record(tmp_path / "call.rzo")
    for ends in (True, False, True):
        recorder.forget()
        for packet in (MODEL, *PACKETS[:2]):
            recorder.add(packet)
        if ends:
            recorder.add(control(ControlKind.END, 7))
            recorder.add(PACKETS[2])
    recorder.forget()
    recorder.close()
    files = sorted(tmp_path.iterdir())
    assert [path.name for path in files] == ["call-2.rzo", "call-3.rzo", "call.rzo"]
    for path, count in zip(files, (9, 7, 7), strict=True):
        assert recorded(path) == [MODEL, *PACKETS[:2], control(ControlKind.END, count)]
    assert {each.path for each in told} == {*files, None} and told[-1] == Recording(None)


def test_what_is_no_packet_is_left_out(recorder: CallRecorder, tmp_path: Path) -> None:
    recorder.record(tmp_path / "call.rzo")
    recorder.add(MODEL[:1] + b"\xff" + MODEL[2:])
    recorder.add(MODEL)
    recorder.add(PACKETS[0])
    recorder.close()
    assert recorded(tmp_path / "call.rzo") == [MODEL, PACKETS[0], control(ControlKind.END, 1)]


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs /dev/full")
def test_a_full_disk_ends_the_recording_and_not_the_call(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    full = tmp_path / "call-2.rzo.part"
    full.symlink_to("/dev/full")
    recorder.record(tmp_path / "call.rzo")
    recorder.add(MODEL)
    recorder.add(PACKETS[0])
    recorder.forget()
    for packet in (MODEL, *PACKETS):
        recorder.add(packet)
    (reason,) = (each.reason for each in told if each.reason)
    assert "No space left" in reason and told[-1].path is None
    recorder.close()
    assert check_whole(tmp_path / "call.rzo") == range(1)


def test_a_folder_that_is_gone_is_said(
    recorder: CallRecorder, told: list[Recording], tmp_path: Path
) -> None:
    recorder.record(tmp_path / "none" / "call.rzo")
    recorder.add(MODEL)
    (recording,) = told
    assert recording.path is None and "there is no folder" in recording.reason


KILLED = """
import os, signal, sys
from pathlib import Path
from protocol.call_file import CallReader
from risorius.live_call.packets.recorder import CallRecorder
recorder = CallRecorder(lambda told: None)
with CallReader(Path(sys.argv[1])) as reader:
    packets = list(reader)
for place, packet in enumerate(packets[:-1]):
    if place == len(packets) - 5:
        recorder.record(Path(sys.argv[2]))
    recorder.add(packet)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_who_is_killed_leaves_what_was_recorded(live_call: Path, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    process = subprocess.run(
        [sys.executable, "-c", KILLED, live_call, path], env=dict(os.environ), check=False
    )
    assert process.returncode == -signal.SIGKILL and not path.exists()
    part = tmp_path / "call.rzo.part"
    report = decode(DecodeOptions(part), lambda done, total: None, lambda: False)
    summary = call_info(part)
    assert not report.complete and not summary.complete
    assert report.frames == summary.frames > 2 * PACKED
