"""A recording of a call that is under way: it begins with the model that its frames need."""

from dataclasses import replace
from pathlib import Path

from layer_streams import BASE, frames

from protocol.call_file import CallReader
from protocol.packets import serialise
from risorius.live_call.packets.recorder import CallRecorder

MODEL = serialise(replace(BASE, version=0, version_count=1))
PACKETS = frames(6, model=replace(BASE, version=0, version_count=1))


def recorded(path: Path) -> list[bytes]:
    with CallReader(path) as reader:
        return list(reader)


def test_a_recording_has_the_model_and_what_came_while_it_ran(tmp_path: Path) -> None:
    recorder = CallRecorder()
    for packet in (MODEL, *PACKETS[:2]):
        recorder.add(packet)
    recorder.record(tmp_path / "call.rzo")
    for packet in PACKETS[2:4]:
        recorder.add(packet)
    recorder.close()
    recorder.add(PACKETS[4])
    assert recorded(tmp_path / "call.rzo") == [MODEL, *PACKETS[2:4]]


def test_another_call_has_another_model(tmp_path: Path) -> None:
    recorder = CallRecorder()
    recorder.add(MODEL)
    recorder.forget()
    recorder.record(tmp_path / "call.rzo")
    recorder.add(PACKETS[0])
    recorder.close()
    assert recorded(tmp_path / "call.rzo") == [PACKETS[0]]


def test_what_is_no_packet_is_left_out(tmp_path: Path) -> None:
    recorder = CallRecorder()
    recorder.record(tmp_path / "call.rzo")
    recorder.add(MODEL[:1] + b"\xff" + MODEL[2:])
    recorder.add(MODEL)
    recorder.close()
    assert recorded(tmp_path / "call.rzo") == [MODEL]
