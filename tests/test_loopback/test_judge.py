"""The judge: who looks, what is compared, and that an independent program finds the same."""

import json
import os
import subprocess
import sys
import wave
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ROOT, ClipFrames

from decoder.sinks.frame_sink import open_sink
from loopback.judge.comparison import compare, observe_source
from loopback.judge.ffmpeg import find_ffmpeg, vmaf
from loopback.judge.identity import face_crop, find_recogniser, mean_likeness
from loopback.judge.learned import learned_distance
from loopback.judge.observer import (
    ENVIRONMENT_VARIABLE,
    EncoderNetworks,
    MediaPipeJudge,
    Observer,
    find_observer,
)
from loopback.judge.voice import VoiceQuality, compare_voices
from risorius.cli import main
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError

EVALUATE = ROOT.parent / "shared" / "tools" / "evaluate.py"
# A small one and one of a head that turns, and how many of their frames.
CLIPS, FRAMES = ("carphone.mp4", "turn.mp4"), 11


def write(path: Path, pictures: list[Picture], aspect: Fraction = Fraction(1)) -> str:
    height, width = pictures[0].shape[:2]
    with open_sink(path, width, height, Fraction(25), sample_aspect=aspect) as sink:
        for picture in pictures:
            sink.write(picture)
    return str(path)


def worse(picture: Picture, index: int) -> Picture:
    """A picture as a codec of few bits might leave it, moved a little now and then."""
    small = cv2.resize(picture, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)
    size = picture.shape[1], picture.shape[0]
    blurred = cv2.resize(small, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.roll(blurred, index % 3, axis=1), np.uint8)


@pytest.fixture(scope="session")
def judge() -> Observer:
    found = find_observer()
    if not found.is_independent:
        pytest.skip("needs a judge: make judge")
    return found


def ignore(done: int, total: int | None) -> None:
    assert done > 0


@pytest.mark.parametrize("name", CLIPS)
def test_the_judge_agrees_with_the_independent_program(
    name: str, judge: MediaPipeJudge, clip_frames: ClipFrames, tmp_path: Path
) -> None:
    if not EVALUATE.is_file():
        pytest.skip(f"needs {EVALUATE}")
    pictures = clip_frames(name, FRAMES)
    source = write(tmp_path / "a.mkv", pictures)
    decoded = write(tmp_path / "b.mkv", [worse(p, i) for i, p in enumerate(pictures)])
    command = [str(judge.python), str(EVALUATE), source, decoded, "--picture"]
    said = subprocess.run(command, capture_output=True, check=True, text=True).stdout
    theirs = json.loads(said[said.index("{") :])
    found = compare(observe_source(source, judge), decoded, judge, ignore, pytest.fail)
    ours = found.figures()
    assert ours["judge"] == "MediaPipe" and ours["frames"] == theirs["frames"] == FRAMES
    theirs["face_psnr_p5_db"] = theirs["face_psnr_p5"]
    for figure, apart in {
        **dict.fromkeys(("face_psnr_db", "face_psnr_p5_db", "full_psnr_db"), 0.1),
        **dict.fromkeys(("person_psnr_db", "background_psnr_db"), 0.1),
        **dict.fromkeys(("face_ssim", "face_found", "flicker_ratio", "jitter_ratio"), 0.01),
        **dict.fromkeys(("mouth_corr", "brow_corr", "blink_corr"), 0.01),
        **dict.fromkeys(("face_ssimulacra2", "picture_ssimulacra2"), 1),
        **dict.fromkeys(("nme_percent", "mouth_mae_percent"), 0.01),
        **dict.fromkeys(("yaw_mae_deg", "pitch_mae_deg", "roll_mae_deg"), 0.01),
    }.items():
        if theirs.get(figure) is not None:
            assert ours[figure] == pytest.approx(theirs[figure], abs=apart + 1e-9), figure


def test_a_face_is_that_of_its_person(judge: MediaPipeJudge, clip_frames: ClipFrames) -> None:
    recogniser = find_recogniser(judge.python)
    if recogniser is None:
        pytest.skip("needs the face recogniser: make judge, with npm")
    pictures = [
        clip_frames(name, 21)[place] for name in ("smile.mp4", "still.mpg") for place in (0, 20)
    ]
    observer = EncoderNetworks()
    crops = [face_crop(each, observer.landmarks([each])[0]) for each in pictures]
    features = recogniser.features(crops)
    likeness = features @ features.T
    assert np.diag(likeness) == pytest.approx(1, abs=1e-5)
    assert min(likeness[0, 1], likeness[2, 3]) > 0.75
    assert likeness[:2, 2:].max() < 0.6
    assert mean_likeness(features, features) == pytest.approx(1, abs=1e-5)


def test_vmaf_falls_with_quality(clip_frames: ClipFrames) -> None:
    program = find_ffmpeg("filters", "libvmaf")
    if program is None:
        pytest.skip("needs an ffmpeg with libvmaf: make judge")
    pictures = clip_frames("smile.mp4", 6)
    size = pictures[0].shape[1], pictures[0].shape[0]
    same = vmaf(program, pictures, pictures, size)
    blurred = vmaf(program, pictures, [worse(p, i) for i, p in enumerate(pictures)], size)
    assert same > 95 and blurred < same - 20
    with pytest.raises(UserError, match="ffmpeg failed at VMAF"):
        vmaf("/bin/false", pictures, pictures, size)


def field(number: int, value: bytes | int) -> bytes:
    """A field of a Protocol Buffers message: a varint below 128, or bytes."""
    if isinstance(value, int):
        return bytes([number << 3, value])
    return bytes([number << 3 | 2]) + varint(len(value)) + value


def varint(value: int) -> bytes:
    low = value & 127
    return bytes([low]) if value < 128 else bytes([low | 128]) + varint(value >> 7)


def mean_difference_network() -> bytes:
    """An ONNX file: the mean of the absolute difference of two pictures."""

    def node(kind: bytes, inputs: list[bytes], output: bytes) -> bytes:
        names = b"".join(field(1, each) for each in inputs)
        return field(1, names + field(2, output) + field(4, kind))

    def value(name: bytes, shape: int) -> bytes:
        sizes = b"".join(field(1, field(2, b"n")) for _ in range(shape))
        tensor = field(1, 1) + field(2, sizes)
        return field(1, name) + field(2, field(1, tensor))

    nodes = node(b"Sub", [b"a", b"b"], b"d") + node(b"Abs", [b"d"], b"e")
    nodes += node(b"ReduceMean", [b"e"], b"m")
    ends = field(11, value(b"a", 4)) + field(11, value(b"b", 4)) + field(12, value(b"m", 4))
    graph = nodes + field(2, b"mean difference") + ends
    return field(1, 7) + field(7, graph) + field(8, field(2, 13))


def test_a_network_of_the_user_measures_pairs(judge: MediaPipeJudge, tmp_path: Path) -> None:
    network = tmp_path / "difference.onnx"
    network.write_bytes(mean_difference_network())
    grey, lighter = (np.full((40, 60, 3), level, np.uint8) for level in (100, 151))
    pairs = [(grey, grey), (grey, lighter)]
    for name, expected in (("dists", 0.1), ("lpips", 0.2)):
        found = learned_distance(name, network, judge, pairs, (60, 40))
        assert found == pytest.approx(expected, abs=1e-4)
    with pytest.raises(UserError, match="make judge"):
        learned_distance("lpips", network, EncoderNetworks(), pairs, (60, 40))
    with pytest.raises(UserError, match="no such file"):
        learned_distance("lpips", tmp_path / "none", judge, pairs, (60, 40))
    network.write_bytes(b"no network")
    with pytest.raises(UserError, match="gives no lpips"):
        learned_distance("lpips", network, judge, pairs * 200, (60, 40))


def test_a_clip_is_like_itself(carphone: Path) -> None:
    observer = EncoderNetworks()
    view = observe_source(str(carphone), observer, 11)
    lines: list[str] = []
    found = compare(view, str(carphone), observer, ignore, lines.append).figures()
    assert found["face_found"] == found["face_ssim"] == found["mouth_corr"] == 1
    assert found["nme_percent"] == found["yaw_mae_deg"] == 0 and found["jitter_ratio"] == 1
    if view.people is not None:
        assert found["person_psnr_db"] == pytest.approx(108, abs=1)
    assert not found["judge_is_independent"]


def test_pixels_that_are_not_square_are_looked_at_in_square_ones(
    clip_frames: ClipFrames, networks: Path, tmp_path: Path
) -> None:
    frames = clip_frames("smile.mp4", 3)
    observer = EncoderNetworks()
    square = observe_source(write(tmp_path / "a.mkv", frames), observer)
    narrow = [np.asarray(cv2.resize(f, None, fx=0.5, fy=1), np.uint8) for f in frames]
    squeezed = observe_source(write(tmp_path / "b.mkv", narrow, Fraction(2)), observer)
    assert squeezed.landmarks == pytest.approx(square.landmarks, abs=4)
    assert squeezed.size == (320, 360)
    lines: list[str] = []
    found = compare(squeezed, squeezed.source, observer, ignore, lines.append).figures()
    assert found["face_frames"] == 3 and found["nme_percent"] == 0


def test_nothing_is_found_without_the_landmark_networks(
    noise: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("encoder.detection.tflite.find_spec", lambda name: None)
    observer = EncoderNetworks()
    view, lines = observe_source(str(noise), observer), list[str]()
    found = compare(view, str(noise), observer, ignore, lines.append)
    assert found.quality.face_psnr_db is None and found.faces.nme_percent is None
    assert any("segmentation" in line for line in lines)


def test_a_named_judge_is_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that is missing is the user's mistake; without a name there is none."""
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, sys.executable)
    assert find_observer().is_independent
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "")
    assert not find_observer().is_independent
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "/nowhere/python")
    with pytest.raises(UserError, match="RISORIUS_JUDGE"):
        find_observer()


def test_a_judge_that_fails_says_why(tmp_path: Path) -> None:
    false = tmp_path / "python"
    false.write_text("#!/bin/sh\necho no such network >&2\nexit 3\n")
    os.chmod(false, 0o755)
    picture = np.zeros((40, 40, 3), np.uint8)
    with pytest.raises(UserError, match="the judge failed: no such network"):
        MediaPipeJudge(false).landmarks([picture] * 99)
    assert MediaPipeJudge(false).landmarks([]).shape == (0, 468, 3)
    assert MediaPipeJudge(false).people([]) == []


def test_the_command_prints_a_table_or_json(
    carphone: Path,
    call: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arguments = ["compare", str(carphone), str(carphone), "--max-frames", "4"]
    assert main([*arguments, "--json", "--call", str(call)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["judge"] == find_observer().name
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "")
    assert main(arguments) == 0
    assert "PSNR of the picture, dB" in capsys.readouterr().out
    assert figures["frames"] == 4 and figures["full_ssim"] == 1
    assert figures["call_bytes"] == call.stat().st_size and not figures.get("voice_estoi")
    other = write(tmp_path / "b.mkv", [np.zeros((40, 40, 3), np.uint8)])
    assert main(["compare", str(carphone), other]) == 2
    assert "40x40" in capsys.readouterr().err


def test_a_voice_is_compared_where_both_have_one(judge: Observer, tmp_path: Path) -> None:
    # As it is repeated for DNSMOS, a single window of that.
    speech = syllables(2.3)
    late = np.concatenate([np.zeros(1600), speech])
    clean, delayed = (
        write_wav(tmp_path / f"{name}.wav", samples)
        for name, samples in (("a", speech), ("b", late))
    )
    found = compare_voices(clean, delayed, judge)
    assert found.voice_late_ms == pytest.approx(100, abs=5)
    assert found.voice_estoi is not None and found.voice_estoi > 0.9
    assert found.voice_dnsmos is not None and 1 <= found.voice_dnsmos <= 5
    noise = np.random.default_rng(0).normal(size=len(speech)) * 3000
    worse = write_wav(tmp_path / "c.wav", speech + noise)
    noisy = compare_voices(clean, worse, EncoderNetworks())
    assert noisy.voice_estoi is not None and noisy.voice_estoi < 0.9
    assert noisy.voice_dnsmos is None
    assert compare_voices(clean, str(tmp_path / "none.wav"), judge) == VoiceQuality()


def syllables(seconds: float, rate_hz: int = 16_000) -> Array:
    """A hum of changing pitch, in syllables."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    pitch = 2 * np.pi * np.cumsum(120 + 30 * np.sin(2 * np.pi * 0.7 * t)) / rate_hz
    hum = sum(np.sin(k * pitch) / k for k in range(1, 20))
    return np.asarray(4000 * hum * np.maximum(np.sin(2 * np.pi * 3.1 * t + np.sin(5 * t)), 0))


def write_wav(path: Path, samples: Array, rate_hz: int = 16_000) -> str:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate_hz)
        file.writeframes(samples.clip(-32768, 32767).astype("<i2").tobytes())
    return str(path)
