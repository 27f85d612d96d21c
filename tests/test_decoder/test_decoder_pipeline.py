"""A recorded call becomes a video of the source's size, rate and length, however it ends."""

from fractions import Fraction
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import pytest
from heads import synthetic_head
from videos import read_frames

from decoder import call_pictures
from decoder.call_pictures import CallPictures
from decoder.pipeline import DecodeOptions, DecodeReport, decode
from decoder.playout.call_source import CallSource
from decoder.playout.received_frames import POLL_S
from decoder.scene import decoded_model
from protocol.call_file import MAGIC, CallReader
from protocol.call_parameters import CallParameters
from protocol.call_records import serialise_records
from protocol.frames.scalar_quantiser import encode_thesis, thesis_sample_count
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, serialise
from shared_model.animate import Face, Identity
from shared_model.arrays import Picture
from shared_model.errors import UserError
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.mesh import Head
from shared_model.parameters import AAUS, EAUS, FaceParameters

WIDTH, HEIGHT, FPS, FRAMES = 176, 144, (30000, 1001), 40
CAMERA = Camera(WIDTH, HEIGHT, 220.0)
REFERENCE = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 600.0]))


def image(value: Picture) -> bytes:
    return cv2.imencode(".webp", value, [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()


def model(background_colour: tuple[int, int, int] = (0, 160, 0), **changes: object) -> bytes:
    call = CallParameters("thesis", WIDTH, HEIGHT, *FPS, CAMERA.focal_px)
    fields: dict[str, object] = {
        "background": image(np.full((HEIGHT, WIDTH, 3), background_colour, dtype=np.uint8)),
        "texture": image(np.full((64, 64, 3), (30, 60, 220), dtype=np.uint8)),
        "reference_rotation": tuple(REFERENCE.rotation),
        "reference_translation_mm": tuple(REFERENCE.translation_mm),
        "aau": (0,) * len(AAUS),
        "reference_eau": (0,) * len(EAUS),
    }
    return serialise(ModelPacket(call, **{**fields, **changes}))  # type: ignore[arg-type]


def pose_at(frame: float) -> FaceParameters:
    """The head moves to the right by 2 mm a frame."""
    pose = pose_from_euler(0, 0, 0, REFERENCE.translation_mm + np.array([2.0 * frame, 0, 0]))
    return FaceParameters(pose)


def samples() -> list[bytes]:
    places = (number * FPS[0] / FPS[1] / 10 for number in count())
    packets = []
    for number, place in zip(range(thesis_sample_count(FRAMES, *FPS)), places, strict=False):
        packets.append(
            serialise(FramePacket(number % 64, encode_thesis(pose_at(place), REFERENCE)))
        )
    return packets


def end(frames: int = FRAMES) -> bytes:
    return serialise(ControlPacket(0, ControlKind.END, frames))


def write_call(path: Path, packets: list[bytes]) -> Path:
    path.write_bytes(MAGIC + serialise_records(packets))
    return path


def run(call: Path, output: Path | None = None) -> DecodeReport:
    return decode(DecodeOptions(call_file=call, output=output), lambda *_: None, lambda: False)


class Waited(CallReader):
    """Notes how many pictures had been shown whenever a packet was waited for."""

    shown = 0

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.before_packet: list[int] = []
        self.waits: list[float | None] = []

    def receive(self, timeout_s: float | None = None) -> Arrival | None:
        self.before_packet.append(self.shown)
        self.waits.append(timeout_s)
        return super().receive(timeout_s)


@pytest.fixture(autouse=True)
def small_head(monkeypatch: pytest.MonkeyPatch) -> Head:
    head = synthetic_head()
    monkeypatch.setattr(decoded_model, "generic_head", lambda: head)
    monkeypatch.setattr(
        decoded_model,
        "face_from_model",
        lambda model, head: Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices))),
    )
    return head


def shown_before_packets(call: Path, is_stream: bool, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many pictures of a call had been shown before each wait for a packet."""
    source = Waited(call)
    monkeypatch.setattr(call_pictures, "open_packet_source", lambda *_: source)

    def progress(done: int, total: int | None) -> None:
        source.shown = done

    with call.open("rb") as stream:
        decode(DecodeOptions(call_file=stream if is_stream else call), progress, lambda: False)
    return source.before_packet


def test_no_picture_of_a_stream_waits_for_the_next_packet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    # A sample, at every 2.997th frame, shows all frames up to its place.
    places = [int(number * FPS[0] / FPS[1] / 10) for number in range(len(samples()))]
    shown = shown_before_packets(call, True, monkeypatch)
    assert shown == [0, 0, *(place + 1 for place in places)]


def test_a_file_is_read_ahead_of_its_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(call_pictures, "FRAMES_AHEAD", 10)
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    # Each picture but the last ones has its successor submitted when it is complete.
    places = [int(number * FPS[0] / FPS[1] / 10) for number in range(len(samples()))]
    shown = shown_before_packets(call, False, monkeypatch)
    assert shown == [0, 0, *(max(0, place + 1 - 10 - 1) for place in places)]


def test_packets_of_a_live_call_are_taken_between_its_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(call_pictures, "MAX_WAITING", 7)
    source = Waited(write_call(tmp_path / "call.rzo", [model(), *samples(), end()]))
    taken = list[int]()
    with CallPictures(CallSource(), lambda: False, source=source) as pictures:
        for frame in pictures:
            source.shown += 1
            taken.append(len(source.before_packet))
            assert frame.index == source.shown - 1
            assert frame.time_s == frame.index * Fraction(FPS[1], FPS[0])
            assert pictures.arrival_s is not None
    assert len(taken) == FRAMES
    # One packet, of three frames, with each picture until enough of them wait.
    assert taken[:6] == [3, 4, 5, 6, 6, 7]
    assert source.waits[:4] == [POLL_S] * 3 + [0] and set(source.waits) == {0, POLL_S}


def test_call_becomes_one_picture_per_source_frame(tmp_path: Path) -> None:
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    report = run(call, tmp_path / "out.mkv")
    pictures = read_frames(tmp_path / "out.mkv")
    assert report.frames == len(pictures) == FRAMES
    assert pictures[0].shape == (HEIGHT, WIDTH, 3)
    assert (report.width, report.height) == (WIDTH, HEIGHT)
    assert report.fps == pytest.approx(30000 / 1001)
    assert report.frame_bytes == 10 * thesis_sample_count(FRAMES, *FPS)
    assert report.model_bytes == len(model()) - 1
    assert report.complete and not report.warnings
    assert [index for index, _ in report.shown_ns] == list(range(FRAMES))
    times = [shown for _, shown in report.shown_ns]
    assert times == sorted(times)
    assert {"animate", "warp", "render", "write"} <= report.stages.stage_ms.keys()


def test_before_its_background_is_known_a_call_is_drawn_on_black(tmp_path: Path) -> None:
    """As to who joined at an update that leaves the background as it was."""
    update, first = model(background=b"", version=1, version_count=2), model()
    packets = [update, *samples()[:6], first, *samples()[6:], end()]
    call, video = write_call(tmp_path / "call.rzo", packets), tmp_path / "out.mkv"
    assert run(call, video).frames == FRAMES - 1
    first_shown, *_, last = read_frames(video)
    assert first_shown[-3, 3].max() < 10 and first_shown[..., 2].max() > 190
    assert last[-3, 3, 1] > 140


def test_the_drawn_face_is_where_the_sent_pose_puts_it(tmp_path: Path, small_head: Head) -> None:
    opaque = small_head.vertices[small_head.opacity > 0.8]
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    run(call, tmp_path / "out.mkv")
    for index, picture in enumerate(read_frames(tmp_path / "out.mkv")):
        face = np.flatnonzero(picture[HEIGHT // 2, :, 2] > 190)
        u = pixel_from_head(CAMERA, pose_at(index).pose, opaque)[:, 0]
        assert abs(face.mean() - (u.min() + u.max()) / 2) < 0.7


def test_cut_off_file_keeps_what_was_there_and_says_so(tmp_path: Path) -> None:
    whole = write_call(tmp_path / "call.rzo", [model(), *samples(), end()]).read_bytes()
    call = tmp_path / "cut.rzo"
    call.write_bytes(whole[:-20])
    report = run(call, tmp_path / "out.mkv")
    assert 0 < report.frames < FRAMES and len(read_frames(tmp_path / "out.mkv")) == report.frames
    assert not report.complete and "cut off" in report.warnings[0]


def test_call_without_end_warns(tmp_path: Path) -> None:
    call = write_call(tmp_path / "call.rzo", [model(), *samples()])
    report = run(call)
    assert report.frames == 39 and "no end" in report.warnings[0]


def test_damaged_frame_is_skipped_with_a_warning(tmp_path: Path) -> None:
    packets = samples()
    packets[5] = packets[5][:1] + bytes(10)
    call = write_call(tmp_path / "call.rzo", [model(), *packets, end()])
    report = run(call)
    assert report.frames == FRAMES and report.complete and report.lost_packets == 1
    assert "damaged packet: " in report.warnings[0]


def test_stopping_keeps_the_pictures_so_far(tmp_path: Path) -> None:
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    done: list[int] = []
    options = DecodeOptions(call_file=call, output=tmp_path / "out.mkv")
    report = decode(options, lambda n, _: done.append(n), lambda: len(done) >= 11)
    # And the one that was being drawn.
    assert report.frames == 12 == len(read_frames(tmp_path / "out.mkv"))
    assert not report.complete


def test_a_stopped_decode_does_not_replace_an_older_video(tmp_path: Path) -> None:
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    output = tmp_path / "out.mkv"
    run(call, output)
    whole, done = output.read_bytes(), list[int]()
    options = DecodeOptions(call_file=call, output=output)
    report = decode(options, lambda n, _: done.append(n), lambda: len(done) >= 11)
    assert output.read_bytes() == whole
    assert report.frames == 12 == len(read_frames(tmp_path / "out.part.mkv"))
    assert "out.mkv is older and stays; what was decoded is in" in report.warnings[-1]


def test_ctrl_c_keeps_the_pictures_so_far(tmp_path: Path) -> None:
    def interrupt(done: int, total: int | None) -> None:
        assert total == FRAMES
        if done == 7:
            raise KeyboardInterrupt

    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    options = DecodeOptions(call_file=call, output=tmp_path / "out.mkv")
    with pytest.raises(KeyboardInterrupt):
        decode(options, interrupt, lambda: False)
    assert len(read_frames(tmp_path / "out.mkv")) == 7


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "no call file"),
        (b"RIFF....AVI ", "no call file"),
        (MAGIC, "no model packet"),
        (MAGIC + serialise_records([end()]), "no model packet"),
        (MAGIC + serialise_records([model()[:-1]]), "model packet"),
        (
            MAGIC
            + serialise_records([model(texture=b"RIFFxxxx")])
            + serialise_records([samples()[0]]),
            "texture is no WebP",
        ),
        (MAGIC + serialise_records([model()[:1] + b"\x63" + model()[2:]]), "format version is 99"),
    ],
)
def test_unusable_call_is_one_line_to_the_user(tmp_path: Path, data: bytes, reason: str) -> None:
    call = tmp_path / "call.rzo"
    call.write_bytes(data)
    with pytest.raises(UserError, match=reason) as caught:
        run(call, tmp_path / "out.mkv")
    assert "call.rzo" in str(caught.value) and "\n" not in str(caught.value)
    assert not (tmp_path / "out.mkv").exists()


def test_missing_file_and_impossible_output_are_the_users_errors(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"cannot read .*none\.rzo"):
        run(tmp_path / "none.rzo")
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    with pytest.raises(UserError, match=r"cannot write .*out\.gif"):
        run(call, tmp_path / "out.gif")


def test_two_runs_write_the_same_pictures(tmp_path: Path) -> None:
    call = write_call(tmp_path / "call.rzo", [model(), *samples(), end()])
    run(call, tmp_path / "a.mkv")
    run(call, tmp_path / "b.mkv")
    for a, b in zip(read_frames(tmp_path / "a.mkv"), read_frames(tmp_path / "b.mkv"), strict=True):
        np.testing.assert_array_equal(a, b)
