"""The thesis profile's sender: samples at their times, also under an update of the shape."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from packets import MODEL

from decoder.playout.playout import Playout, PlayoutFrame
from encoder.calls.packet_sender import LEAD_PACKETS, PacketSender
from encoder.calls.session_stats import SessionStats
from encoder.thesis.thesis_session import FixedRateSender
from protocol.call_file import CallReader, CallWriter
from protocol.link.delivery.model_cache import ModelCache
from protocol.model_packet import ModelPacket
from protocol.packets import parse_packet
from shared_model.parameters import FaceParameters, Pose, with_focal_change

LONGER = 1.25
ANNOUNCED, FRAMES = 31, 90


def model(fps: tuple[int, int]) -> ModelPacket:
    call = replace(MODEL.call, fps_numerator=fps[0], fps_denominator=fps[1], start_frame=2)
    return replace(MODEL, call=call, sequence=0)


def longer(before: ModelPacket) -> ModelPacket:
    """An update of the shape: another lens, the face as much farther away, no pictures."""
    call = replace(before.call, focal_px=LONGER * before.call.focal_px)
    x, y, z = before.reference_translation_mm
    return replace(
        before,
        call=call,
        reference_translation_mm=(x, y, LONGER * z),
        texture=b"",
        background=b"",
    )


def face(index: int, focal: float = 1.0) -> FaceParameters:
    """The caller goes aside by a millimetre a frame."""
    place = np.add(MODEL.reference_translation_mm, (index, 0, 0))
    return with_focal_change(FaceParameters(Pose(MODEL.reference_pose.rotation, place)), focal)


def call(
    path: Path, fps: tuple[int, int] = (25, 1), lost: range = range(0)
) -> tuple[list[bytes], list[tuple[PlayoutFrame, ModelPacket]], int]:
    """A call with an update: its packets, what is played by which model, and where it begins."""
    start = FRAMES
    with CallWriter(path / "call.rzo") as file:
        packets = PacketSender(file, SessionStats())
        sender = FixedRateSender(packets, model(fps))
        for index in range(2, FRAMES):
            if index in lost:
                sender.report_lost(index)
                continue
            sender.send_face(index, face(index, LONGER if index >= start else 1.0))
            if index == ANNOUNCED:
                start = sender.announce_update(longer(sender.model))
        packets.end(FRAMES)
    with CallReader(path / "call.rzo") as file_again:
        sent = list(file_again)
    playout, shown = Playout(), []
    for packet in sent:
        for frame in playout.receive(parse_packet(packet)):
            assert playout.model is not None
            shown.append((frame, playout.model))
    return sent, shown, start


@pytest.mark.parametrize("fps", [(25, 1), (30000, 1001), (24, 1), (60, 1), (12, 1), (4, 1), (7, 2)])
def test_every_frame_is_played_at_its_time_under_the_shape_that_it_is_of(
    fps: tuple[int, int], tmp_path: Path
) -> None:
    _, shown, start = call(tmp_path, fps)
    assert [frame.index for frame, _ in shown] == list(range(FRAMES))
    samples = 10 * (start - ANNOUNCED) * fps[1] / fps[0]
    assert LEAD_PACKETS - 1 < samples <= LEAD_PACKETS + 2 + 10 * fps[1] / fps[0]
    last = max(frame.index for frame, _ in shown if frame.index < FRAMES - fps[0] / fps[1] / 10)
    for frame, drawn_by in shown:
        assert drawn_by.texture == MODEL.texture and drawn_by.background == MODEL.background
        focal = drawn_by.call.focal_px / MODEL.call.focal_px
        expected = face(min(max(frame.index, 2), last), focal).pose.translation_mm
        np.testing.assert_allclose(frame.face.pose.translation_mm, expected, rtol=0.02, atol=3)
    assert shown[start][1].version == 1 and shown[ANNOUNCED - 1][1].version == 0


@pytest.mark.parametrize("lost", [range(33, 40), range(33, 60), range(25, 31)])
def test_an_update_outlives_a_loss(lost: range, tmp_path: Path) -> None:
    _, shown, start = call(tmp_path, lost=lost)
    assert [frame.index for frame, _ in shown] == list(range(FRAMES))
    assert [frame.index for frame, _ in shown if frame.frozen and frame.index >= 2] == list(lost)
    for frame, drawn_by in shown[max(start, lost[-1] + 4) :]:
        assert drawn_by.version == 1
        expected = face(min(frame.index, FRAMES - 2), LONGER).pose.translation_mm
        np.testing.assert_allclose(frame.face.pose.translation_mm, expected, rtol=0.02, atol=3)


def test_who_joins_after_an_update_gets_the_pictures_that_stayed(tmp_path: Path) -> None:
    sent, _, _ = call(tmp_path, lost=range(33, 60))
    kept = ModelCache()
    for data in sent:
        kept.on_sent(data)
    (whole,) = kept.packets
    packet = parse_packet(whole)
    assert isinstance(packet, ModelPacket) and packet.version == 1
    assert packet.texture == MODEL.texture and packet.background == MODEL.background
    playout = Playout()
    assert not playout.receive(parse_packet(whole))
    assert playout.model == packet


def test_an_update_weighs_little(tmp_path: Path) -> None:
    sent, _, _ = call(tmp_path)
    models = [p for p in map(parse_packet, sent) if isinstance(p, ModelPacket)]
    assert [len(p.texture) + len(p.background) for p in models][1:] == [0]
    assert [p.version_count for p in models] == [1, 2]
