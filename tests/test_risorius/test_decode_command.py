"""`risorius decode`: damaged calls, outputs, and the comparison with the source."""

import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import PROGRAM, ROOT
from processes import error_line, one_line
from videos import copy_frames

from decoder.sinks.frame_sink import open_sink
from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source
from loopback.quality.video_quality import Quality
from protocol.summary import summarise
from risorius.cli import main
from risorius.command_line.idle_timeout import IdleTimeout
from risorius.commands.decode import quality_summary

Capture = pytest.CaptureFixture[str]


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_psnr_of_no_pictures_is_none() -> None:
    nothing = Quality(0, 0, None, None, None, None)
    assert quality_summary(nothing) == "PSNR: no picture measured"
    no_face = Quality(9, 0, None, None, 31.0, 30.0)
    assert quality_summary(no_face) == "PSNR: no face measured, picture 31.00 dB"


@pytest.mark.parametrize("endpoint", ["ftp/127.0.0.1:1", "tcp/a b:1"])
def test_an_endpoint_that_is_none_is_named(endpoint: str, call: Path, capsys: Capture) -> None:
    assert main(["decode", "--listen", endpoint, "-q"]) == 2
    assert endpoint in error_line(capsys)


def test_a_truncated_call_is_decoded_as_far_as_it_goes(
    call: Path, tmp_path: Path, capsys: Capture
) -> None:
    short = tmp_path / "short.rzo"
    short.write_bytes(call.read_bytes()[:-30])
    report = tmp_path / "report.json"
    assert main(["decode", str(short), "--report", str(report), "-q"]) == 0
    assert "cut off" in error_line(capsys)
    figures = json.loads(report.read_text())
    assert 0 < figures["frames"] < 30
    assert not figures["complete"]


@pytest.mark.parametrize("name", ["none/out.mkv", "out.xyz"])
def test_an_output_that_cannot_be_written_is_one_line(
    name: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["decode", str(call), "-o", str(tmp_path / name), "-q"]) == 2
    assert "cannot write" in error_line(capsys)


@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
def test_a_decoded_video_has_the_colour_matrix_of_its_source(
    matrix: str, carphone: Path, tmp_path: Path
) -> None:
    source, call, decoded = (tmp_path / name for name in ("in.mkv", "call.rzo", "out.mkv"))
    copy_frames(carphone, source, 5, matrix)
    assert main(["encode", str(source), "-o", str(call), "--profile", "thesis", "-q"]) == 0
    assert summarise(call).colour_matrix == matrix
    assert main(["decode", str(call), "-o", str(decoded), "-q"]) == 0
    with open_source(str(decoded)) as capture:
        assert capture.colour_matrix == matrix


def test_decode_measures_against_the_source(
    call: Path, carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    first = tmp_path / "first.mkv"
    copy_frames(carphone, first, 30)
    report = tmp_path / "report.json"
    arguments = ["decode", str(call), "--source", str(first), "--report", str(report)]
    assert main(arguments) == 0
    quality = json.loads(report.read_text())["quality"]
    assert quality["frames"] == quality["face_frames"] == 30
    assert quality["face_psnr_db"] > 20
    assert f"face {quality['face_psnr_db']:.2f} dB" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("none.mkv", "no such file"),
        ("out.mkv", "another name"),
        ("text.mp4", "not a video"),
        ("noise.mkv", "is 176x144 but"),
    ],
)
def test_a_source_that_cannot_be_compared_is_refused_before_decoding(
    name: str, reason: str, call: Path, noise: Path, tmp_path: Path, capsys: Capture
) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    (tmp_path / "noise.mkv").symlink_to(noise)
    arguments = ["--source", str(tmp_path / name), "-o", str(tmp_path / "out.mkv"), "-q"]
    assert main(["decode", str(call), *arguments]) == 2
    assert reason in error_line(capsys)
    assert not (tmp_path / "out.mkv").exists()


def test_a_comparison_that_fails_does_not_hide_what_was_decoded(
    call: Path, tmp_path: Path, capsys: Capture
) -> None:
    for number in range(30):
        width = 176 if number < 20 else 160
        cv2.imwrite(str(tmp_path / f"f{number:02d}.png"), np.zeros((144, width, 3), np.uint8))
    out, report = tmp_path / "out.mkv", tmp_path / "report.json"
    source = str(tmp_path / "f%02d.png")
    arguments = ["-o", str(out), "--source", source, "--report", str(report)]
    assert main(["decode", str(call), *arguments]) == 2
    said = capsys.readouterr()
    assert "frame 20 is 160x144" in one_line(said.err)
    assert said.out.startswith("30 frames of 176x144") and out.exists()
    figures = json.loads(report.read_text())
    assert figures["frames"] == 30 and "quality" not in figures


@pytest.mark.parametrize("frames", [20, 40])
def test_frames_that_call_and_source_have_are_compared(
    frames: int, call: Path, carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    source, report = tmp_path / "source.mkv", tmp_path / "report.json"
    copy_frames(carphone, source, frames)
    line = ["decode", str(call), "--source", str(source), "--report", str(report), "-q"]
    assert main(line) == 0
    common = min(frames, 30)
    said = f"source.mkv has {frames} frames, the call 30: PSNR of the first {common}"
    assert said in error_line(capsys)
    assert json.loads(report.read_text())["quality"]["frames"] == common


def test_a_container_is_not_believed_that_promises_frames_it_has_not(
    call: Path, carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    whole, cut = tmp_path / "whole.mkv", tmp_path / "cut.mkv"
    copy_frames(carphone, whole, 40)
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    with open_source(str(cut)) as source:
        there = sum(1 for _ in source)
    assert 10 < there < 30
    assert main(["decode", str(call), "--source", str(cut), "-q"]) == 0
    assert f"cut.mkv has {there} frames, the call 30" in error_line(capsys)


def test_a_source_of_another_call_is_suspected(call: Path, tmp_path: Path, capsys: Capture) -> None:
    blank = tmp_path / "blank.mkv"
    with open_sink(blank, 176, 144, exact_fps(30)) as sink:
        for _ in range(30):
            sink.write(np.zeros((144, 176, 3), np.uint8))
    assert main(["decode", str(call), "--source", str(blank)]) == 0
    said = capsys.readouterr()
    assert "PSNR: no face measured, picture " in said.out
    assert "blank.mkv what the call was made of?" in one_line(said.err)


def test_a_call_and_its_video_go_through_pipes(call: Path, tmp_path: Path) -> None:
    video = tmp_path / "out.y4m"
    with call.open("rb") as given, video.open("wb") as taken:
        line = [*PROGRAM, "decode", "-", "-o", "-"]
        done = subprocess.run(line, stdin=given, stdout=taken, stderr=subprocess.PIPE, cwd=ROOT)
    assert done.returncode == 0
    assert b"30 frames of 176x144" in done.stderr
    header, *frames = video.read_bytes().split(b"FRAME\n")
    assert header == b"YUV4MPEG2 W176 H144 F30000:1001 Ip A128:117 C444\n"
    assert [len(frame) for frame in frames] == 30 * [3 * 176 * 144]


def test_a_video_that_goes_into_a_pipe_is_not_compared(call: Path, capsys: Capture) -> None:
    assert main(["decode", str(call), "-o", "-", "--source", "me.mp4"]) == 2
    assert "does not go with -o -" in error_line(capsys)


def test_an_idle_timeout_ends_only_when_nothing_comes() -> None:
    clock = Clock()
    timeout = IdleTimeout(2.0, lambda: False, clock)
    noted = timeout.watch(lambda done, total: None)
    clock.now = 1.5
    noted(1, None)
    clock.now = 3.0
    assert not timeout()
    clock.now = 3.6
    assert timeout() and timeout.expired


def test_a_decoder_does_not_wait_for_a_call_it_could_not_write(
    tmp_path: Path, capsys: Capture
) -> None:
    assert main(["decode", "--listen", "tcp/127.0.0.1:0", "-o", str(tmp_path / "a.txt")]) == 2
    assert "name it .avi" in error_line(capsys)
