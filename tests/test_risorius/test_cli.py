"""The program as a whole: help, one line for each mistake, exit codes, closed streams."""

import json
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT
from processes import LIMIT_S, error_line, one_line

from encoder.capture.video_source import open_source
from risorius.cli import build_parser, main
from risorius.command_line.parser import INTERNAL_ERROR, TRACEBACK_VARIABLE

COMMANDS = (
    "encode",
    "decode",
    "calls",
    "relay",
    "invite",
    "keys",
    "bench",
    "replay",
    "info",
    "track",
    "annotate",
    "train",
    "animate",
    "view",
    "demo",
    "compile",
    "completion",
)

Capture = pytest.CaptureFixture[str]


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
    assert all(f"\n    {command}" in text for command in COMMANDS)


def test_the_program_alone_prints_its_help(capsys: Capture) -> None:
    assert main([]) == 0
    assert "examples:" in capsys.readouterr().out


def test_the_version_is_printed(capsys: Capture) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert re.fullmatch(r"risorius \S+\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("line", "libraries"),
    [("--help", "cv2 numpy numba zenoh moderngl"), ("info {call}", "cv2 av numba zenoh moderngl")],
)
def test_a_quick_command_loads_no_library_that_it_does_not_need(
    line: str, libraries: str, call: Path
) -> None:
    code = (
        "import sys; from risorius.cli import main\n"
        f"try: main({line.format(call=call).split()!r})\n"
        "except SystemExit: pass\n"
        f"sys.exit(any(name in sys.modules for name in {libraries.split()!r}))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize(
    "arguments",
    [
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
    assert "--help" in error_line(capsys)


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
    assert expected in error_line(capsys)


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


@pytest.mark.parametrize(
    ("library", "extra", "command"),
    [
        ("ai_edge_litert", "encoder", ["encode", "CLIP", "-o", "FOLDER/none.rzo", "-q"]),
        ("aiohttp", "call", ["call", "--listen", "127.0.0.1:0", "--voice", "off"]),
        ("moderngl", "decoder", ["decode", "CALL"]),
        ("threadpoolctl", "encoder", ["encode", "none.mp4", "-o", "none.rzo"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_missing_extra_is_named(
    library: str, extra: str, command: list[str], call: Path, carphone: Path, tmp_path: Path
) -> None:
    files = {"CALL": str(call), "CLIP": str(carphone)}
    arguments = [files.get(word, word.replace("FOLDER", str(tmp_path))) for word in command]
    code = (
        f"import sys; sys.modules['{library}'] = None; from risorius.cli import main;"
        f"sys.exit(main({arguments!r}))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    assert f"pip install '.[{extra}]'" in one_line(result.stderr)


def test_an_interrupt_while_the_command_line_loads_is_one_line() -> None:
    code = (
        "import sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name == 'risorius.cli': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from risorius.__main__ import main\n"
        "sys.exit(main())"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stderr) == (130, "risorius: interrupted\n")


def test_an_interrupt_that_machine_code_hides_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def loading(arguments: object) -> int:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise SystemError("returned a result with an exception set") from interrupt

    monkeypatch.setattr("risorius.commands.info.run_info", loading)
    assert main(["info", "call.rzo"]) == 130
    assert "interrupted" in error_line(capsys)


@pytest.mark.parametrize("kind", [SystemError, ValueError])
def test_a_mistake_of_the_program_has_an_exit_code_of_its_own(
    kind: type[Exception], monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    def failing(arguments: object) -> int:
        raise kind("bad argument\nof a function")

    monkeypatch.setattr("risorius.commands.info.run_info", failing)
    assert main(["info", "call.rzo"]) == INTERNAL_ERROR
    assert f"internal error, {kind.__name__}: bad argument of a function" in error_line(capsys)
    monkeypatch.setenv(TRACEBACK_VARIABLE, "1")
    assert main(["info", "call.rzo"]) == INTERNAL_ERROR
    assert "in failing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "meant", "prog"),
    [
        ("encod a.mp4", "did you mean encode?", "risorius"),
        ("encode a.mp4 -o b.rzo --bitrat 800", "did you mean --bitrate?", "risorius encode"),
        ("decode a.rzo --otput b.mkv", "did you mean --output?", "risorius decode"),
        ("encode a.mp4 -o b.rzo --profile thesi", "did you mean thesis?", "risorius encode"),
        ("info a.rzo --wxyz", "unrecognized arguments: --wxyz", "risorius info"),
    ],
)
def test_what_was_meant_is_asked_and_the_right_help_named(
    line: str, meant: str, prog: str, capsys: Capture
) -> None:
    assert main(line.split()) == 2
    message = error_line(capsys)
    assert meant in message and message.endswith(f"; see {prog} --help")


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (["info", "-"], "info does not read standard input"),
        (["encode", "", "-o", "a.rzo"], "the name of the source is empty"),
    ],
)
def test_what_is_no_file_name_is_not_called_a_missing_file(
    line: list[str],
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line) == 2
    assert reason in error_line(capsys)


def test_an_empty_standard_input_is_said(tmp_path: Path) -> None:
    line = [*PROGRAM, "encode", "-", "-o", str(tmp_path / "a.rzo")]
    done = subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "risorius: nothing came from standard input"
    assert not (tmp_path / "a.rzo").exists()


def test_a_call_of_standard_input_is_that_of_the_file(carphone: Path, tmp_path: Path) -> None:
    piped, own = tmp_path / "piped.rzo", tmp_path / "file.rzo"
    options = ["--max-frames", "5", "--model-bytes", "2000", "-q"]
    with carphone.open("rb") as file:
        line = [*PROGRAM, "encode", "-", "-o", str(piped), *options]
        subprocess.run(line, stdin=file, check=True)
    assert main(["encode", str(carphone), "-o", str(own), *options]) == 0
    assert piped.read_bytes() == own.read_bytes()


def test_an_interrupted_animation_has_the_truth_of_its_pictures(tmp_path: Path) -> None:
    script, video, part = (tmp_path / name for name in ("a.toml", "a.mkv", "a.part.mkv"))
    script.write_text("width = 160\nheight = 120\nfps = 25\nseconds = 3600\nnoise = 30\n")
    process = subprocess.Popen(
        [*PROGRAM, "animate", str(script), "-o", str(video)], stdout=subprocess.PIPE, text=True
    )
    try:
        # Some pictures of noise.
        while process.poll() is None and not (part.exists() and part.stat().st_size > 500_000):
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.05)
        process.send_signal(signal.SIGINT)
        told, _ = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
    assert process.returncode == 130 and told.startswith("interrupted: ")
    truth = json.loads((tmp_path / "a.json").read_text())
    with open_source(str(video)) as source:
        assert len(list(source)) == len(truth["frames"]) > 1


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
def test_nothing_is_written_over_what_is_read(line: str, tmp_path: Path, capsys: Capture) -> None:
    recording = tmp_path / "me.mp4"
    recording.write_bytes(b"the only one")
    other = tmp_path / "folder" / ".." / "me.mp4"
    (tmp_path / "folder").mkdir()
    assert main(line.format(recording, other).split()) == 2
    assert "another name" in error_line(capsys)
    assert recording.read_bytes() == b"the only one"


@pytest.mark.parametrize(
    "option", ["--bitrate", "--startup-bitrate", "--fps", "--max-frames", "--wait", "--model-bytes"]
)
def test_what_is_no_number_is_said(option: str, capsys: Capture) -> None:
    assert main(["encode", "me.mp4", "-o", "x.rzo", option, "many"]) == 2
    assert "many is not a" in error_line(capsys)


def test_every_command_has_something_to_run() -> None:
    parser = build_parser()
    assert callable(parser.parse_args(["info", "a.rzo"]).run)


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_a_shell_can_complete_commands_and_options(shell: str, capsys: Capture) -> None:
    pytest.importorskip("shtab")
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert "encode" in text and "startup-bitrate" in text


def test_bash_completes(capsys: Capture, tmp_path: Path) -> None:
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "risorius.bash"
    script.write_text(capsys.readouterr().out)
    ask = (
        f"source {script}; COMP_WORDS=(risorius enc); COMP_CWORD=1;"
        "$(complete -p risorius | sed -E 's/.*-F ([^ ]+).*/\\1/') risorius enc risorius;"
        'echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["encode"]
