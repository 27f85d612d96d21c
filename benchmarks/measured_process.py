"""The processes of a measurement: how they are started and listened to, and what they use."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from benchmarks.command import PROGRAM
from shared_model.errors import UserError

Process = subprocess.Popen[str]
POLL_S = 0.05
# The place of idle time in a line of `/proc/stat`, and its least share on an idle machine.
IDLE, MOSTLY = 3, 0.9


def start_module(stack: ExitStack, module: str, *arguments: object) -> Process:
    """A module that runs as a program, by standard input and output; killed with the stack."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=os.environ)
    stack.callback(_kill, process)
    return process


def start_relay(stack: ExitStack, arguments: Sequence[str], ready: str) -> tuple[Process, str]:
    """`risorius relay`, killed with the stack, and its first message with `ready` in it.

    Raises `UserError` if it ends before.
    """
    command = [*PROGRAM, "relay", *arguments]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    stack.callback(_kill, process)
    assert process.stderr is not None
    line = ""
    for line in process.stderr:
        if ready in line:
            return process, line
    raise UserError(f"a relay did not start: {line.strip()}")


def next_line(process: Process, expected: str | None = None) -> str:
    """The next line of a process.  Raises `UserError` if it has ended, or says something else."""
    assert process.stdout is not None
    line = process.stdout.readline().strip()
    if not line or (expected is not None and line != expected):
        raise UserError(f"a process of the measurement ended early: {line!r}")
    return line


def holds_within(condition: Callable[[], bool], limit_s: float) -> bool:
    """Wait until a condition holds; whether it does after so many seconds at the latest."""
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() >= end_s:
            return False
        time.sleep(POLL_S)
    return True


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, seconds (Linux); also of one that has just ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_until_idle(limit_s: float) -> None:
    """Wait until nothing takes the processors (Linux), but no longer than so many seconds."""
    before = _idle_and_all_ticks()

    def is_idle() -> bool:
        nonlocal before
        now = _idle_and_all_ticks()
        idle, all_ticks = now[0] - before[0], now[1] - before[1]
        before = now
        return all_ticks > 0 and idle >= MOSTLY * all_ticks

    holds_within(is_idle, limit_s)


def _idle_and_all_ticks() -> tuple[int, int]:
    """Of all processors together: those in which they were idle, and all."""
    ticks = [int(each) for each in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
    return ticks[IDLE], sum(ticks)


def memory_bytes(pid: int) -> int:
    """Resident memory of a process (Linux)."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _kill(process: Process) -> None:
    process.kill()
    process.wait()
