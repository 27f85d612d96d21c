"""A live call: frames go out as they come, and the model is trained again meanwhile."""

from fractions import Fraction
from itertools import count, islice, pairwise
from pathlib import Path

from call_contents import packets_of, played
from conftest import LIVE_MODEL_BYTES, without_layers
from live_encoders import live_encoder
from shots import draw, talking

from decoder.pipeline import DecodeOptions, decode
from encoder.calls.session_stats import SessionStats
from encoder.capture.live_capture import NO_PICTURE, FrameMailbox, LiveCapture
from encoder.capture.video_source import open_source
from encoder.detection.landmark_indices import INNER_LIP_PAIRS
from encoder.detection.landmarks import open_landmark_tracker
from encoder.detection.tflite import find_segmentation_network
from encoder.live_model.model_version import RESERVED_MODES
from encoder.live_model.pacing import UNPACED
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from protocol.call_file import CallWriter
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, parse_packet
from protocol.pictures.layered_background import is_layered
from shared_model.parameters import EAU_INDEX

FRAMES, FPS = 75, 25


def test_an_update_is_announced_ahead_of_its_first_packet(live_call: Path) -> None:
    packets = packets_of(live_call)
    models = [(i, p) for i, p in enumerate(packets) if isinstance(p, ModelPacket)]
    assert [model.version for _, model in models] == [0, 1]
    (_, first), (place, update) = models
    none_yet, some = (parse_transform(model.profile_data) for model in (first, update))
    assert (
        none_yet.reserved_modes
        == some.reserved_modes
        == RESERVED_MODES
        == len(none_yet.modes)
        < len(some.modes)
    )
    assert not any(none_yet.modes) and first.background
    has_layers = find_segmentation_network() is not None
    assert is_layered(update.background) if has_layers else not update.background
    assert is_layered(first.background) == has_layers == (none_yet.layers > 0)
    before = sum(isinstance(packet, FramePacket) for packet in packets[:place])
    assert update.sequence == before + UNPACED.lead_packets
    learned = min(UNPACED.updates) * FPS
    assert update.call.start_frame > learned
    assert isinstance(packets[-1], ControlPacket) and packets[-1].kind is ControlKind.END


def test_the_single_first_frame_of_an_update_is_counted(networks: Path, tmp_path: Path) -> None:
    """At so few frames a second the next is due before the one before holds."""
    draw(tmp_path / "slow.mkv", talking(7, fps=6))
    clip, path = tmp_path / "slow.mkv", tmp_path / "slow.rzo"
    options = EncodeOptions(str(clip), path, live=True, model_bytes=LIVE_MODEL_BYTES)
    with without_layers():
        encode(options, lambda done, total: None, lambda: False)
    packets = packets_of(path)
    models = [packet for packet in packets if isinstance(packet, ModelPacket)]
    assert len(models) == 3
    for before, after in pairwise(models):
        # The first packet of a model holds one frame.
        number = after.sequence - before.sequence
        frames = 1 + (number - 1) * before.call.frames_per_packet
        assert after.call.start_frame == before.call.start_frame + frames


def test_every_frame_has_one_face_across_the_update(live_call: Path) -> None:
    frames = played(live_call)
    assert [frame.index for frame in frames] == list(range(FRAMES))
    jaw = [frame.face.eau[EAU_INDEX["jaw_drop"]] for frame in frames]
    assert min(jaw[26:34]) < 0.15 < 0.25 < max(jaw[8:18])
    assert not frames[0].face.modes.any() and frames[-1].face.modes.any()


def lip_gaps_px(video: Path) -> list[float]:
    """How far the lips are apart in each frame of a drawn face, by the landmark network."""
    tracker, (upper, lower) = open_landmark_tracker(), map(list, INNER_LIP_PAIRS)
    gaps = []
    with open_source(str(video)) as frames:
        for _, picture in frames:
            found = tracker.update(picture)
            assert found is not None
            gaps.append(float((found.points[lower, 1] - found.points[upper, 1]).mean()))
    return gaps


def test_a_live_call_is_drawn_with_the_model_of_each_frame(
    live_call: Path, talking_clip: Path, tmp_path: Path
) -> None:
    options = DecodeOptions(call_file=live_call, output=tmp_path / "out.mkv")
    report = decode(options, lambda done, total: None, lambda: False)
    assert report.frames == FRAMES and not report.warnings
    # Before the update and after it, when the opening is shared between the jaw and modes.
    seen, drawn = lip_gaps_px(talking_clip), lip_gaps_px(tmp_path / "out.mkv")
    for part in (slice(8, 18), slice(70, None)):
        assert 0.75 * max(seen[part]) < max(drawn[part]) < 1.25 * max(seen[part])
    assert min(drawn[26:34]) < 0.25 * max(seen)


def test_a_camera_may_leave_frames_out_and_be_switched_off(
    talking_clip: Path, tmp_path: Path
) -> None:
    """Frames come late and are left out; the call keeps the source's time."""
    mailbox = FrameMailbox(Fraction(FPS))
    path, off, end = tmp_path / "gaps.rzo", 50, 66
    with open_source(str(talking_clip)) as frames:
        pictures = {i: p for i, p in frames if i not in {20, 21, *range(30, 42)}}
    mailbox.put(pictures[0], 0.0)
    capture = LiveCapture("camera", mailbox, Fraction(FPS))
    stats = SessionStats()
    with CallWriter(path) as sink, without_layers():
        session = live_encoder(capture, sink, stats, LIVE_MODEL_BYTES, realtime=False)
        for index in range(end):
            if index < off and index in pictures:
                session.frame(index, pictures[index])
            elif index >= off:
                session.frame(index, NO_PICTURE)
        session.end(end)
    shown = played(path)
    assert [frame.index for frame in shown] == list(range(end))
    assert not any(frame.frozen for frame in shown)
    news = [each for each in packets_of(path) if isinstance(each, ControlPacket)]
    assert ControlPacket(0, ControlKind.CAMERA_OFF, off) in news
    jaw = [frame.face.eau[EAU_INDEX["jaw_drop"]] for frame in shown]
    assert max(jaw[:off]) > 0.2 and abs(jaw[-1]) < 0.05
    # Two frames between two others lie between them, too.
    low, high = sorted((jaw[19], jaw[22]))
    assert all(low - 0.1 <= value <= high + 0.1 for value in jaw[20:22])


class FirstFrameClock:
    """A clock by which the first frame takes a quarter of a second, and no other any time."""

    def __init__(self) -> None:
        self._calls = count()

    def __call__(self) -> float:
        return 0.25 if next(self._calls) else 0.0


class FramePacketCounter(CallWriter):
    """Counts the frame packets that it writes."""

    frame_packets = 0

    def send(self, packet: bytes) -> None:
        """See `CallWriter`."""
        self.frame_packets += isinstance(parse_packet(packet), FramePacket)
        super().send(packet)


def test_packets_of_the_first_seconds_are_no_later_than_the_first_one(
    carphone: Path, networks: Path, tmp_path: Path
) -> None:
    stats, sent_at = SessionStats(), list[int]()
    with (
        open_source(str(carphone)) as capture,
        FramePacketCounter(tmp_path / "call.rzo") as sink,
        without_layers(),
    ):
        session = live_encoder(
            capture, sink, stats, LIVE_MODEL_BYTES, realtime=True, clock=FirstFrameClock()
        )
        for index, picture in islice(capture, FRAMES):
            session.frame(index, picture)
            sent_at += [index] * (sink.frame_packets - len(sent_at))
        fps = float(capture.fps)
        session.end(index + 1)
    # The last frames of a packet are known every second frame.
    waits = [at - 8 * number for number, at in enumerate(sent_at)]
    late = int(0.25 * fps)
    assert waits[0] == 0 and set(waits[1:7]) <= {late, late + 1}
    # After two seconds a packet is coded when it is full.
    assert waits[-1] <= 1
