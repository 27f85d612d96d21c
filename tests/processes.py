"""Processes of the program that a test starts: waiting for them, and reading their output."""

import re
import subprocess
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pytest

# What takes longer is stuck, however busy the machine is: a test that passes never waits so long.
LIMIT_S = 600.0
PROGRESS = re.compile(r"\w+ (\d+ frames|\|[#.]*\| \d+/\d+) \d+/s")


def without_progress(stderr: str) -> list[str]:
    """The lines of stderr without those of progress, of which a slow host sees some."""
    return [line for line in stderr.splitlines() if not PROGRESS.match(line)]


def one_line(stderr: str) -> str:
    """The text of stderr, which is a single line besides progress."""
    lines = without_progress(stderr)
    assert len(lines) == 1, stderr
    assert lines[0].startswith("risorius: ")
    return lines[0]


def error_line(capsys: "pytest.CaptureFixture[str]") -> str:
    """The single line that the program has written to stderr."""
    return one_line(capsys.readouterr().err)


def first_line(process: subprocess.Popen[str]) -> str:
    """The first line that a process writes to stderr, without the line break."""
    assert process.stderr is not None
    return process.stderr.readline().rstrip("\n")


def until(condition: Callable[[], bool], action: Callable[[], object] = lambda: None) -> None:
    """Repeat `action` until `condition` holds."""
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, "it took too long"
        action()
        time.sleep(0.02)


def wait_until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait until `condition` holds; fail if `process` ends first."""

    def still_runs() -> None:
        assert process.poll() is None, process.communicate()

    until(condition, still_runs)


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and stderr."""
    _, stderr = process.communicate(timeout=LIMIT_S)
    return process.returncode, stderr
