"""The log of a call: silent by default, on the screen or in a file, of child processes, too."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from risorius.cli import main
from runtime.child_process import start_child
from shared_model.logs import FILE_VARIABLE, LEVEL_VARIABLE, follow_environment


@pytest.fixture(autouse=True)
def silent_again() -> Iterator[None]:
    """The log of this process as it was."""
    root = logging.getLogger()
    kept, level = root.handlers[:], root.level
    yield
    root.handlers[:] = kept
    root.setLevel(level)
    for name in (LEVEL_VARIABLE, FILE_VARIABLE):
        os.environ.pop(name, None)


def encode(carphone: Path, folder: Path, *options: str) -> int:
    arguments = ["encode", str(carphone), "--profile", "thesis", "--max-frames", "6", "-q"]
    return main([*arguments, "-o", str(folder / "a.rzo"), *options])


def test_without_an_option_there_is_no_log(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert encode(carphone, tmp_path) == 0
    assert "INFO" not in capsys.readouterr().err


def test_once_says_what_changes_and_twice_each_packet(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert encode(carphone, tmp_path, "-v") == 0
    once = capsys.readouterr().err
    assert "encoder.calls.packet_sender: model 0 is sent" in once and "frame packet" not in once
    assert encode(carphone, tmp_path, "-vv") == 0
    assert "frame packet 0 is sent" in capsys.readouterr().err


def test_a_file_gets_all_of_it_at_its_end(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "call.log"
    log.write_text("of before\n")
    assert encode(carphone, tmp_path, "--log", str(log)) == 0
    text = log.read_text()
    assert text.startswith("of before\n") and "frame packet 0 is sent" in text
    assert "DEBUG" not in capsys.readouterr().err
    assert encode(carphone, tmp_path, "--log", str(tmp_path / "none" / "a.log")) == 2
    assert "cannot write the log" in capsys.readouterr().err


def test_a_child_process_logs_into_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "call.log"
    monkeypatch.setenv(LEVEL_VARIABLE, str(logging.INFO))
    monkeypatch.setenv(FILE_VARIABLE, str(log))
    (tmp_path / "one_line.py").write_text(
        "import logging\ndef serve(descriptor):\n    logging.getLogger('child').info('here')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    process, ours = start_child("one_line")
    with ours:
        assert process.wait(60) == 0
    assert log.read_text().endswith("INFO child: here\n")
    follow_environment()
    logging.getLogger("parent").info("too")
    assert log.read_text().endswith("INFO parent: too\n")
