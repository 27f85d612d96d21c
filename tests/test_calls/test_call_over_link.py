"""What a user sees of a call over a link: whom it waits for, who has gone, how it ends."""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT, Start
from processes import (
    LIMIT_S,
    error_line,
    finish,
    first_line,
    one_line,
    wait_until,
    without_progress,
)
from videos import EndlessVideo, endless_video

from encoder.capture.video_source import open_source
from risorius.cli import main

Capture = pytest.CaptureFixture[str]
WAIT = ("--wait", str(LIMIT_S))
THESIS = ("--profile", "thesis", *WAIT)
# Without an end: few frames are to be encoded and decoded while processes start.
PACED = (*THESIS, "--pace")
NOBODY = "encode: nobody listens any more; sending on"


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Where a decoder may write."""
    return tmp_path / "out.mkv"


@pytest.fixture
def endless(carphone: Path, tmp_path: Path) -> Iterator[EndlessVideo]:
    with endless_video(carphone, tmp_path / "endless.y4m") as opened:
        yield opened


def wait_for_pictures(video: Path, decoder: subprocess.Popen[str]) -> None:
    """Wait until the decoder has written some."""
    part = video.with_suffix(".part.mkv")
    wait_until(lambda: part.exists() and part.stat().st_size > 60_000, decoder)


def going_on(
    start: Start, clip: EndlessVideo, endpoint: str, video: Path
) -> tuple[subprocess.Popen[str], subprocess.Popen[str]]:
    """Decoder and encoder of a call of which some pictures are written."""
    decoder = start("decode", "--listen", endpoint, "-o", video, "-q")
    encoder = start("encode", clip.path, "--connect", endpoint, *PACED, "-q")
    wait_for_pictures(video, decoder)
    return decoder, encoder


def count_pictures(video: Path) -> int:
    with open_source(str(video)) as capture:
        return sum(1 for _ in capture)


def test_a_port_in_use_is_a_failed_link(capsys: Capture) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert main(["decode", "--listen", f"tcp/127.0.0.1:{port}", "-q"]) == 4
    assert "in use" in error_line(capsys)


def test_a_decoder_without_a_caller_gives_up_when_told_to(endpoint: str, capsys: Capture) -> None:
    assert main(["decode", "--listen", endpoint, "--timeout", "0.5", "-q"]) == 4
    assert "no call came within 0.5 s" in error_line(capsys)


def test_an_encoder_without_a_decoder_gives_up(
    carphone: Path, endpoint: str, capsys: Capture
) -> None:
    assert main(["encode", str(carphone), "--listen", endpoint, "--wait", "0.5", "-q"]) == 4
    assert "no decoder" in error_line(capsys)


@pytest.mark.parametrize("command", ["decode --timeout", "encode {} --wait"])
def test_who_cannot_connect_gives_up_in_the_time_given(
    command: str, carphone: Path, endpoint: str, capsys: Capture
) -> None:
    line = command.format(carphone).split()
    assert main([*line, "0.5", "--connect", endpoint, "-q"]) == 4
    assert f"cannot reach {endpoint} within 0.5 s" in error_line(capsys)


@pytest.mark.parametrize(
    ("command", "awaited"), [("decode", "an encoder"), ("encode {}", "a decoder")]
)
def test_who_waits_says_for_whom_and_where_and_is_interrupted_at_once(
    command: str, awaited: str, start: Start, carphone: Path, endpoint: str
) -> None:
    line = command.format(carphone).split()
    process = start(*line, "--listen", endpoint, "--call", "anna")
    assert first_line(process) == "this call is not encrypted: it stays on this host"
    assert first_line(process) == f"{line[0]}: listening on {endpoint} for {awaited} of call 'anna'"
    process.send_signal(signal.SIGINT)
    code, stderr = finish(process)
    assert code == 130
    assert one_line(stderr) == "risorius: interrupted"


def test_a_stopped_decoder_leaves_a_video_that_plays(
    start: Start, endless: EndlessVideo, endpoint: str, video: Path
) -> None:
    decoder, encoder = going_on(start, endless, endpoint, video)
    decoder.send_signal(signal.SIGINT)
    code, stderr = finish(decoder)
    assert code == 130 and "Traceback" not in stderr
    assert count_pictures(video) > 0
    encoder.send_signal(signal.SIGINT)
    assert finish(encoder)[0] == 130


def test_a_call_goes_on_by_itself_after_its_encoder_is_killed_and_started_again(
    start: Start, carphone: Path, endless: EndlessVideo, endpoint: str, video: Path
) -> None:
    decoder, encoder = going_on(start, endless, endpoint, video)
    encoder.kill()
    encoder.wait()
    with endless_video(carphone, video.with_name("again.y4m")) as again:
        line = ["encode", str(again.path), "--connect", endpoint, *THESIS, "-q"]
        assert main([*line, "--max-frames", "20"]) == 0, finish(decoder)
    code, stderr = finish(decoder)
    assert code == 0
    assert "the encoder has started again: 1 times" in stderr
    assert count_pictures(video) > 20


def test_a_decoder_whose_encoder_leaves_without_a_face_fails(
    start: Start, noise: Path, networks: Path, endpoint: str
) -> None:
    decoder = start("decode", "--listen", endpoint, "-q")
    assert main(["encode", str(noise), "--connect", endpoint, *THESIS, "-q"]) == 3
    code, stderr = finish(decoder)
    assert code == 4
    assert "its encoder left before it sent a face" in one_line(stderr)


def test_an_encoder_whose_decoder_is_killed_sends_on_and_says_so(
    start: Start, endless: EndlessVideo, endpoint: str, video: Path
) -> None:
    encoder = start("encode", endless.path, "--listen", endpoint, *PACED)
    assert "not encrypted" in first_line(encoder)
    assert "listening on" in first_line(encoder)
    decoder = start("decode", "--connect", endpoint, "-o", video)
    wait_for_pictures(video, decoder)
    decoder.kill()
    while (line := first_line(encoder)) != NOBODY:
        assert not without_progress(line), line
    endless.end()
    stdout, stderr = encoder.communicate(timeout=LIMIT_S)
    assert encoder.returncode == 0
    assert without_progress(stderr) == ["risorius: warning: nobody listened when the call ended"]
    assert f"{endless.count} frames of 176x144" in stdout and "nobody heard its end" in stdout


def test_a_call_goes_on_by_itself_after_its_relay_is_started_again(
    start: Start, endless: EndlessVideo, endpoint: str, video: Path
) -> None:
    relay = start("relay", "--listen", endpoint)
    assert first_line(relay) == f"relay: listening on {endpoint}"
    encoder = start("encode", endless.path, "--connect", endpoint, *PACED, "-q")
    decoder = start("decode", "--connect", endpoint, "-o", video, "-q")
    wait_for_pictures(video, decoder)
    relay.terminate()
    assert finish(relay)[0] == 0
    again = start("relay", "--listen", endpoint)
    assert first_line(again) == f"relay: listening on {endpoint}"
    endless.end()
    assert finish(encoder)[0] == 0
    assert finish(decoder)[0] == 0
    assert count_pictures(video) == endless.count
    again.terminate()
    assert finish(again)[0] == 0


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_relay_stops_whichever_thread_takes_the_signal(endpoint: str) -> None:
    code = (
        "import os, signal, sys, threading; from risorius.cli import main\n"
        "def interrupt():\n"
        "    sys.stdin.read()\n"
        "    asleep = 0\n"
        "    while asleep < 200:\n"
        "        with open(f'/proc/self/task/{os.getpid()}/stat') as file: state = file.read()\n"
        "        asleep = asleep + 1 if state.split()[2] == 'S' else 0\n"
        "    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)\n"
        "threading.Thread(target=interrupt).start()\n"
        "sys.exit(main(['relay', '--listen', sys.argv[1]]))"
    )
    relay = subprocess.Popen(
        [sys.executable, "-c", code, endpoint],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert first_line(relay) == f"relay: listening on {endpoint}"
        relay.communicate(timeout=LIMIT_S)
        assert relay.returncode == 0
    finally:
        relay.kill()
