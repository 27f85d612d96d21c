"""A part of a call that was recorded is read frame by frame, at its time in the call."""

from dataclasses import replace
from pathlib import Path

import pytest
from layer_streams import BASE, PACKED, frames
from recordings import (
    FIRST,
    MODEL,
    PACKETS,
    check_whole,
    control,
    first_frame,
    numbered,
    record_part,
    recorded,
    shown,
)

from decoder.pipeline import DecodeOptions, decode
from decoder.playout.receiver import Receiver
from protocol.frames.frame_times import TimesPacket
from protocol.link.interface import Arrival
from protocol.packets import (
    ControlKind,
    FramePacket,
    PacketKind,
    packet_kind,
    parse_packet,
    serialise,
)
from protocol.summary import summarise
from protocol.voice.voice_block import VoiceBlock, join_payload
from risorius.live_call.packets.recorder import CallRecorder


@pytest.fixture
def recorder() -> CallRecorder:
    return CallRecorder(lambda told: None)


@pytest.mark.parametrize("stops", [True, False])
def test_a_recording_shows_what_the_call_shows_from_any_packet_on(
    stops: bool, live_call: Path, tmp_path: Path
) -> None:
    """The first three packets do without the prediction from those before."""
    packets, call, playout = recorded(live_call), shown(live_call), Receiver()
    is_frame = [packet_kind(packet) is PacketKind.FRAME for packet in packets]
    before = [0]  # frames of the call before each packet
    for packet in packets:
        before.append(before[-1] + len(playout.receive(Arrival(packet, 0.0))))
    for begin in range(2, len(packets) - 7, 3):
        path = tmp_path / f"{begin}.rzo"
        end = begin + 6 if stops else len(packets)
        record_part(path, packets, begin, end)
        if not any(is_frame[begin:end]):
            assert not path.exists()
            continue
        assert check_whole(path) == range(before[begin], before[end])
        for each in shown(path)[3 * PACKED :]:
            face, truth = each.face, call[each.index].face
            assert (face.eau == truth.eau).all()
            assert (face.pose.translation_mm == truth.pose.translation_mm).all()


def test_a_recording_from_the_middle_on_is_drawn_frame_by_frame(
    live_call: Path, tmp_path: Path
) -> None:
    path, packets = tmp_path / "call.rzo", recorded(live_call)
    record_part(path, packets, len(packets) - 5, len(packets) - 2)
    report = decode(
        DecodeOptions(path, output=tmp_path / "out.mkv"), lambda done, total: None, lambda: False
    )
    summary = summarise(path)
    assert report.complete and report.frames == summary.frames > 0
    assert report.lost_packets == report.lost_frames == report.before_join == 0
    (warning,) = report.warnings
    assert warning.startswith("joined a call under way")


@pytest.mark.parametrize("begin", [1, 64, 130])
def test_a_recording_begins_at_its_time_however_long_the_call_has_been(
    begin: int, tmp_path: Path
) -> None:
    """An update waits from packet 120 on for 135."""
    update = replace(BASE, version=1, version_count=2, sequence=135 % 64)
    sent = [MODEL, *frames(135, model=FIRST)]
    sent.insert(121, serialise(replace(update, call=replace(BASE.call, start_frame=1 + 134 * 8))))
    sent += numbered(135, frames(10, model=update))
    place = 1 + begin + (begin >= 120)
    path = tmp_path / "call.rzo"
    record_part(path, sent, place, len(sent))
    # The first packet of a model has one face.
    starts = [*map(first_frame, range(136)), *range(first_frame(135) + 1, 2000, PACKED)]
    assert check_whole(path) == range(starts[begin], starts[145])


def test_lost_packets_are_frames_of_a_recording_that_nobody_has_seen(
    recorder: CallRecorder, tmp_path: Path
) -> None:
    path, sent = tmp_path / "call.rzo", frames(100, model=FIRST)
    recorder.add(MODEL, 0)
    for number in range(70):
        recorder.add(sent[number], number)
    recorder.record(path)
    # That of before the beginning is late; three are lost, and of two the second comes first.
    for number in (69, 71, 72, 74, 73, 77, 80):
        recorder.add(sent[number], number)
    recorder.close()
    assert check_whole(path) == range(first_frame(71), first_frame(81))
    lost = {each.index for each in shown(path) if each.lost}
    assert set(range(first_frame(75), first_frame(77))) < lost


def test_a_long_silence_of_the_link_leaves_a_file_that_is_whole(
    recorder: CallRecorder, tmp_path: Path
) -> None:
    path, sent = tmp_path / "call.rzo", frames(130, model=FIRST)
    recorder.add(MODEL, 0)
    recorder.add(sent[3], 3)
    recorder.record(path)
    for number in (*range(4, 8), *range(60, 130)):
        recorder.add(sent[number], number)
    recorder.close()
    assert check_whole(path) == range(first_frame(4), first_frame(130))


def test_while_the_face_is_lost_a_recording_waits_and_ends_with_what_is_known(
    recorder: CallRecorder, tmp_path: Path
) -> None:
    first, second = tmp_path / "first.rzo", tmp_path / "second.rzo"
    sent = frames(30, model=FIRST)
    for packet in (MODEL, *sent[:2], control(ControlKind.FACE_LOST, first_frame(2))):
        recorder.add(packet)
    recorder.record(first)
    recorder.add(control(ControlKind.PERSON_GONE, first_frame(2) + 20))
    recorder.add(control(ControlKind.FACE_FOUND, first_frame(20)))
    recorder.add(sent[20])
    recorder.add(control(ControlKind.FACE_LOST, first_frame(21)))
    recorder.add(control(ControlKind.FACE_FOUND, first_frame(25)))
    recorder.record(second)
    recorder.add(sent[25])
    recorder.close()
    assert check_whole(first) == range(first_frame(20), first_frame(25))
    assert check_whole(second) == range(first_frame(25), first_frame(26))


def test_a_recording_begins_with_the_state_of_the_call(
    recorder: CallRecorder, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    times = [serialise(TimesPacket(0, first, (3,) * 4)) for first in (0, 4, 8)]
    off = control(ControlKind.CAMERA_OFF, 3)
    for packet in (MODEL, *times, off, *PACKETS[:2]):
        recorder.add(packet)
    recorder.record(path)
    recorder.add(PACKETS[2])
    assert recorded(path.with_name("call.rzo.part"))[2:] == [*times[1:], off, PACKETS[2]]
    recorder.add(control(ControlKind.CAMERA_ON, 17))
    recorder.record(path)
    recorder.add(PACKETS[3])
    recorder.close()
    assert recorded(path)[2:4] == times[1:]


def test_a_voice_is_heard_when_it_was_spoken(recorder: CallRecorder, tmp_path: Path) -> None:
    path = tmp_path / "call.rzo"
    model = replace(FIRST, call=replace(FIRST.call, voice="700C"))
    spoken = VoiceBlock(tuple(bytes([i, 0, 0, 0]) for i in range(1, 7)))

    def voiced(packet: bytes, block: VoiceBlock) -> bytes:
        parsed = parse_packet(packet)
        assert isinstance(parsed, FramePacket)
        face = parsed.payload if block.has_face else b""
        return serialise(replace(parsed, payload=join_payload("700C", block, face)))

    sent = frames(90, model=FIRST)
    recorder.add(serialise(model))
    for packet in sent[:80]:
        recorder.add(voiced(packet, spoken))
    recorder.record(path)
    recorder.add(voiced(sent[80], spoken))
    recorder.add(control(ControlKind.FACE_LOST, first_frame(81)))
    recorder.add(voiced(sent[81], replace(spoken, has_face=False)))
    recorder.close()
    assert check_whole(path) == range(first_frame(80), first_frame(82))
    playout = Receiver()
    for data in recorded(path):
        playout.receive(Arrival(data, 0.0))
    begin = int(first_frame(80) * 25 / FIRST.call.fps)
    heard = [playout.speech.get(index) for index in range(begin - 10, begin + 40)]
    assert sum(frame in spoken.frames for frame in heard) == 12
