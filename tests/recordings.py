"""Recordings of calls under way, and what is read of them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from layer_streams import BASE, PACKED, frames

from decoder.playout.duration import count_frames
from decoder.playout.playout import PlayoutFrame
from decoder.playout.receiver import Receiver
from protocol.call_file import CallReader
from protocol.link.interface import Arrival
from protocol.packets import ControlKind, ControlPacket, serialise
from protocol.summary import summarise
from risorius.live_call.packets.recorder import CallRecorder

FIRST = replace(BASE, version=0, version_count=2)
MODEL = serialise(FIRST)
PACKETS = frames(6, model=FIRST)


def control(kind: ControlKind, frame: int) -> bytes:
    return serialise(ControlPacket(0, kind, frame))


def recorded(path: Path) -> list[bytes]:
    with CallReader(path) as reader:
        return list(reader)


def shown(path: Path) -> list[PlayoutFrame]:
    """The faces of a call file, which has to be whole."""
    playout = Receiver()
    faces = [each for data in recorded(path) for each in playout.receive(Arrival(data, 0.0))]
    assert playout.ended
    return faces


def check_whole(path: Path) -> range:
    """A recording has a face for each of its frames, one after the other: these frames."""
    indices = [each.index for each in shown(path)]
    assert indices == list(range(indices[0], indices[-1] + 1))
    summary = summarise(path)
    assert summary.complete and summary.frames == count_frames(path) == len(indices)
    assert "damaged" not in summary.groups or not summary.groups["damaged"]
    return range(indices[0], indices[-1] + 1)


def first_frame(number: int) -> int:
    return 1 + PACKED * (number - 1) if number else 0


def numbered(first: int, packets: list[bytes]) -> list[bytes]:
    """Frame packets that are numbered from `first` on."""
    return [bytes([(first + i) % 64]) + packet[1:] for i, packet in enumerate(packets)]


def record_part(path: Path, packets: Sequence[bytes], begin: int, end: int) -> None:
    """Record `packets[begin:end]` of a call of which all are sent."""
    recorder = CallRecorder(lambda told: None)
    for place, packet in enumerate(packets):
        if place == begin:
            recorder.record(path)
        if place == end:
            recorder.close()
        recorder.add(packet)
    recorder.close()
