"""An encoder and a decoder as two processes of this host that talk over Zenoh."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shared_model.errors import LINK_FAILED, UserError

CALL = "bench"
POLL_S = 0.05
TERMINATION_GRACE_S = 5.0


@dataclass(frozen=True, slots=True)
class CallResult:
    """The reports (JSON) of both ends of one call."""

    encoder: dict[str, Any]
    decoder: dict[str, Any]


@dataclass(frozen=True, slots=True)
class _Process:
    name: str
    process: subprocess.Popen[bytes]
    log: Path

    def error_text(self) -> str:
        """The process's last word, without the program's name."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        last = lines[-1].removeprefix("risorius: ") if lines else "it said nothing"
        code = self.process.returncode
        return f"the {self.name} stopped with {code}: {last} (all of it: {self.log})"


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """So many busy loops of normal priority for the time of the `with` block."""
    loop = [sys.executable, "-c", "while True: pass"]
    loops = [subprocess.Popen(loop) for _ in range(count)]
    try:
        yield
    finally:
        for each in loops:
            each.kill()
            each.wait()


@contextmanager
def pinned(cores: str | None) -> Iterator[None]:
    """Let what the `with` block starts run on these cores alone, as in "0" or "0,2"; None: on all.

    Raises `UserError` if this system cannot, or has no such core.
    """
    if cores is None:
        yield
        return
    try:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {int(core) for core in cores.split(",")})
    except (AttributeError, OSError, ValueError) as error:
        raise UserError(f"cannot run on the cores {cores!r}: expected numbers as in 0,1") from error
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def run_call(
    source: str, output: Path, encoder_options: Sequence[str], limit_s: float
) -> CallResult:
    """Encode `source` in one process, decode it into `output` in another, and wait for both.

    Reports and logs stay next to `output`.  Raises `UserError` with the exit code of the end that
    failed, or if they are not done within `limit_s`; no process outlives the call.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    # The encoder waits for the decoder by itself, then it may go through the whole source first.
    options = {
        "decoder": ["--listen", endpoint, "-o", str(output), "--timeout", str(limit_s)],
        "encoder": [source, "--connect", endpoint, "--wait", str(limit_s), *encoder_options],
    }
    processes: list[_Process] = []
    try:
        for end, its_options in options.items():
            processes.append(_start(end, output, its_options))
        _wait(processes, time.monotonic() + limit_s)
    finally:
        for item in processes:
            _terminate(item.process)
    return CallResult(
        **{end: json.loads(_report(output, end).read_text("utf-8")) for end in options}
    )


def free_port() -> int:
    """A TCP port of this host that is free at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _report(output: Path, end: str) -> Path:
    return output.with_suffix(f".{end}.json")


def _start(name: str, output: Path, options: Sequence[str]) -> _Process:
    log = output.with_suffix(f".{name}.log")
    common = ["--call", CALL, "--quiet", "--report", str(_report(output, name))]
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", name, *options, *common],
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    return _Process(name, process, log)


def _wait(processes: list[_Process], deadline: float) -> None:
    while any(item.process.poll() is None for item in processes):
        if any(item.process.poll() for item in processes):
            raise _failure(processes)
        if time.monotonic() > deadline:
            names = " and ".join(item.name for item in processes if item.process.poll() is None)
            raise UserError(f"the {names} did not end in time", LINK_FAILED)
        time.sleep(POLL_S)
    if any(item.process.returncode for item in processes):
        raise _failure(processes)


def _failure(processes: list[_Process]) -> UserError:
    """The error of an end that failed; of the encoder if both did, since the decoder follows it."""
    failed = [item for item in processes if item.process.poll()]
    for item in reversed(processes):
        with suppress(subprocess.TimeoutExpired):
            if item.process.wait(TERMINATION_GRACE_S):
                failed = [item]
                break
    code = failed[0].process.returncode
    return UserError(failed[0].error_text(), code if 0 < code < 128 else LINK_FAILED)


def _terminate(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(TERMINATION_GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
