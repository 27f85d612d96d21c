"""The default profile from pictures to pictures, on a clip whose truth is known.

The clip has odd sides, begins without a face, and loses it for a while.
"""

import json
import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from call_contents import packets_of
from conftest import PROGRAM, ROOT, without_layers
from shots import draw, talking

from decoder.playout.frame_decoder import TimedFace, frame_decoder_for
from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_session import send_call
from encoder.calls.session_stats import SessionStats
from encoder.calls.two_pass_session import EncodedCall, hold_last_detection
from encoder.coding.gop import FRAMES_PER_PACKET
from encoder.fitting.sequence_fit import pick_diverse_frames, smooth_landmarks
from encoder.options import EncodeOptions
from encoder.pipeline import encode as encode_clip
from loopback.quality.video_quality import face_mask_finder, measure_quality
from protocol.call_file import CallWriter
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
)
from protocol.summary import summarise
from risorius.cli import main
from shared_model.geometry import euler_deg
from shared_model.parameters import EAU_INDEX

FRAMES, START = 54, 2
LOST = range(19, 30)
# Of a call that is stopped.
PASS_FRAMES = 14
# A lost face is looked for less and less often.
FOUND = LOST.stop + 8
FPS = 25
BITRATE = 1500
# A small model is learned faster.
MODEL_BYTES = "5000"


@dataclass(frozen=True, slots=True)
class Clip:
    """Where its pictures are, and what is true in each."""

    pattern: str
    truth: list[dict[str, Any]]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> Clip:
    folder = tmp_path_factory.mktemp("clip")
    report = draw(folder / "frame%03d.png", talking(FRAMES / FPS, FPS, 241, 181))
    for index in (*range(START), *LOST):
        path = str(folder / f"frame{index:03d}.png")
        cv2.imwrite(path, np.full((181, 241, 3), 90, np.uint8))
    truth = json.loads(report.truth.read_text())["frames"]
    assert len(truth) == FRAMES
    return Clip(str(folder / "frame%03d.png"), truth)


def encode(clip: Clip, output: Path, *more: str) -> None:
    options = ["--profile", "default", "--bitrate", str(BITRATE), "-q", *more]
    options += ["--model-bytes", MODEL_BYTES]
    assert main(["encode", clip.pattern, "-o", str(output), *options]) == 0


@pytest.fixture(scope="module")
def call(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clip as a call; next to it `stderr.txt`, what `risorius encode` says of it."""
    path = tmp_path_factory.mktemp("call") / "call.rzo"
    with path.with_name("stderr.txt").open("w") as stderr, redirect_stderr(stderr):
        encode(clip, path)
    return path


def samples(path: Path) -> Iterator[TimedFace]:
    first, *rest = packets_of(path)
    assert isinstance(first, ModelPacket)
    decoder, number = frame_decoder_for(first), 0
    for packet in rest:
        if isinstance(packet, FramePacket):
            yield from decoder.decode(number, packet.payload)
            number += 1


def seen_samples(path: Path) -> dict[int, TimedFace]:
    """By source frame, where there was a face."""
    found = {int(sample.timestamp): sample for sample in samples(path)}
    return {
        frame: sample for frame, sample in found.items() if frame < LOST.start or frame >= FOUND
    }


def test_every_frame_from_the_first_face_on_is_sent_once(call: Path) -> None:
    places = [sample.timestamp for sample in samples(call)]
    assert places == [Fraction(frame) for frame in range(START, FRAMES)]


def test_the_face_moves_as_it_was_drawn(call: Path, clip: Clip) -> None:
    found = seen_samples(call)
    jaw = [sample.face.eau[EAU_INDEX["jaw_drop"]] for sample in found.values()]
    true_jaw = [clip.truth[frame]["eau"][EAU_INDEX["jaw_drop"]] for frame in found]
    assert np.corrcoef(jaw, true_jaw)[0, 1] > 0.9
    yaw = np.array([euler_deg(sample.face.pose)[1] for sample in found.values()])
    true_yaw = np.array([clip.truth[frame]["pitch_yaw_roll_deg"][1] for frame in found])
    assert np.abs(yaw - true_yaw - np.median(yaw - true_yaw)).max() < 2.5


def test_a_smile_is_seen_beside_speech(tmp_path: Path, networks: Path) -> None:
    pattern = tmp_path / "frame%03d.png"
    report = draw(pattern, talking(FRAMES / FPS, FPS, 161, 121, smile=0.5))
    smiling = Clip(str(pattern), json.loads(report.truth.read_text())["frames"])
    with without_layers():
        encode(smiling, tmp_path / "call.rzo")
    corners = EAU_INDEX["mouth_corners"]
    found = {int(sample.timestamp): sample for sample in samples(tmp_path / "call.rzo")}
    seen = [sample.face.eau[corners] for sample in found.values()]
    drawn = [smiling.truth[frame]["eau"][corners] for frame in found]
    assert np.corrcoef(seen, drawn)[0, 1] > 0.95


def test_how_many_frames_had_no_face_is_said(call: Path) -> None:
    stderr = call.with_name("stderr.txt").read_text()
    (told,) = re.findall(rf"no face in (\d+) of {FRAMES} frames", stderr)
    missed = START + len(LOST)
    assert missed <= int(told) <= missed + FOUND - LOST.stop


def test_a_lost_face_is_held_and_told(call: Path) -> None:
    control = [packet for packet in packets_of(call) if isinstance(packet, ControlPacket)]
    kinds = [packet.kind for packet in control]
    assert kinds == [
        ControlKind.FACE_LOST,
        ControlKind.PERSON_GONE,
        ControlKind.FACE_FOUND,
        ControlKind.END,
    ]
    lost, gone, found, end = (packet.frame for packet in control)
    assert lost <= gone < found
    # Told with the first packet that has no face, and the first that has one again.
    assert LOST.start <= lost < LOST.start + FRAMES_PER_PACKET
    assert LOST.stop - FRAMES_PER_PACKET < found <= FOUND and end == FRAMES
    faces = {int(sample.timestamp): sample.face for sample in samples(call)}
    held = [faces[frame] for frame in LOST]
    for face in held[:-1]:
        shift = face.pose.translation_mm - faces[LOST.start - 1].pose.translation_mm
        assert np.abs(shift).max() < 6


def test_the_decoded_video_is_near_where_there_is_a_face(
    call: Path, clip: Clip, tmp_path: Path
) -> None:
    assert main(["decode", str(call), "-o", str(tmp_path / "d%03d.png"), "-q"]) == 0
    pattern = str(tmp_path / "d%03d.png")
    find_face_mask = face_mask_finder(pytest.fail)
    quality = measure_quality(clip.pattern, pattern, find_face_mask, lambda done, total: None)
    assert quality.frames == FRAMES
    assert FRAMES - START - 8 <= quality.face_frames + len(LOST) <= FRAMES - START
    assert quality.face_psnr_db is not None and quality.face_psnr_db > 30
    first = cv2.imread(pattern % 0)
    assert first is not None and first.shape == (181, 241, 3)


def test_the_rate_is_kept(call: Path) -> None:
    summary = summarise(call)
    assert summary.record_bps <= BITRATE
    assert sum(summary.groups.values()) == pytest.approx(summary.frame_bytes)


@pytest.fixture(params=["demo clip", "still.mpg"])
def call_of_default_sizes(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "demo clip":
        return Path(request.getfixturevalue("demo_run")) / "out" / "demo" / "call.rzo"
    clip, path = request.getfixturevalue("clips") / request.param, tmp_path / "call.rzo"
    assert main(["encode", str(clip), "-o", str(path), "--max-frames", "12", "-q"]) == 0
    return path


def test_a_face_takes_eight_kilobytes_and_all_of_a_model_twelve(
    networks: Path, call_of_default_sizes: Path
) -> None:
    parts = summarise(call_of_default_sizes).model_parts
    background = parts.pop("background")
    assert 7000 < sum(parts.values()) <= 8192
    assert 2500 < background <= 3700


def test_two_faces_are_a_call_of_the_same_bytes_on_any_number_of_threads(
    clip: Clip, tmp_path: Path
) -> None:
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
    count = START + 2
    options = ("--max-frames", str(count), "--model-bytes", MODEL_BYTES, "-q")
    one, two = (tmp_path / f"{threads}.rzo" for threads in (1, 2))
    # OpenBLAS has one thread in the processes of tests, and OpenCV as well.
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1" and cv2.getNumThreads() == 1
    assert main(["encode", clip.pattern, "-o", str(one), *options]) == 0
    subprocess.run(
        [*PROGRAM, "encode", clip.pattern, "-o", str(two), *options],
        check=True,
        cwd=ROOT,
        env={**os.environ, **dict.fromkeys(names, "2")},
    )
    assert one.read_bytes() == two.read_bytes()
    assert [sample.timestamp for sample in samples(one)] == list(range(START, count))


def test_a_clip_of_a_single_face_is_a_call(clip: Clip, tmp_path: Path) -> None:
    path = tmp_path / "short.rzo"
    encode(clip, path, "--max-frames", str(START + 1))
    assert [sample.timestamp for sample in samples(path)] == [START]


@pytest.mark.parametrize("frames", [5, PASS_FRAMES + 9])
def test_stopped_in_the_second_pass_a_call_is_kept_and_in_the_first_there_is_none(
    clip: Clip, frames: int, tmp_path: Path
) -> None:
    output, sent, done = tmp_path / "stopped.rzo", frames - PASS_FRAMES, 0

    def progress(_: int, total: int | None) -> None:
        nonlocal done
        done += 1

    options = EncodeOptions(clip.pattern, output, model_bytes=2000, max_frames=PASS_FRAMES)
    if sent < 0:
        with pytest.raises(KeyboardInterrupt):
            encode_clip(options, progress, lambda: done >= frames)
        assert list(tmp_path.iterdir()) == []
        return
    with without_layers():
        report = encode_clip(options, progress, lambda: done >= frames)
    assert [sample.timestamp for sample in samples(output)] == list(range(START, sent))
    assert report.frames == summarise(output).frames == sent


def test_a_call_that_stops_while_it_is_sent_ends_where_it_stopped(
    call: Path, tmp_path: Path
) -> None:
    output, stats = tmp_path / "part.rzo", SessionStats()
    model, *rest = packets_of(call)
    assert isinstance(model, ModelPacket)
    payloads = tuple(packet.payload for packet in rest if isinstance(packet, FramePacket))
    asked = iter([False, False, True])
    with CallWriter(output) as sink:
        whole = EncodedCall(model, payloads, FRAMES, frozenset())
        send_call([whole], PacketSender(sink, stats), None, lambda: next(asked))
    frames = START + 1 + 2 * FRAMES_PER_PACKET
    assert [sample.timestamp for sample in samples(output)] == list(range(START, frames))
    assert stats.frames == summarise(output).frames == frames


def test_a_clip_without_a_face_has_its_own_exit_code(
    noise: Path, networks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "none.rzo"
    assert main(["encode", str(noise), "-o", str(output), "--profile", "default"]) == 3
    assert "no face found" in capsys.readouterr().err
    assert not output.exists()


def test_a_frame_without_a_face_holds_the_one_before() -> None:
    assert hold_last_detection({3: 0, 4: 1, 7: 2}, 3, 9) == [0, 1, 1, 1, 2, 2]


def test_smoothing_calms_noise_and_keeps_the_length() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(40, 468, 3))
    calm = smooth_landmarks(points)
    assert calm.shape == points.shape and calm.std() < 0.6 * points.std()
    still = np.tile(points[:1], (9, 1, 1))
    assert np.allclose(smooth_landmarks(still), still)
    assert np.array_equal(smooth_landmarks(points[:2]), points[:2])


def test_identity_frames_are_spread_over_the_turns() -> None:
    points = np.zeros((100, 468, 3))
    points[:, 1, 0] = np.sin(np.arange(100) / 7)
    points[:, 1, 1] = np.cos(np.arange(100) / 5)
    chosen = pick_diverse_frames(points)
    turns = points[chosen, 1, :2]
    assert len(chosen) <= 10 and turns.min() < -0.9 and turns.max() > 0.9
    assert pick_diverse_frames(points[:1]) == [0]
