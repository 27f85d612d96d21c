"""Signals: the first asks to stop, the second interrupts; a crash says where it happened."""

import signal
import subprocess
import sys

import pytest
from conftest import ROOT

from risorius.command_line.signals import StopOnSignal


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


def test_a_crash_says_where_it_happened() -> None:
    code = (
        "import os, signal\n"
        "from risorius.cli import main\n"
        "def crash():\n"
        "    os.kill(os.getpid(), signal.SIGABRT)\n"
        "main(['info', 'nosuch.rzo'])\n"
        "crash()"
    )
    line = [sys.executable, "-c", code]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGABRT
    assert "Fatal Python error: Aborted" in done.stderr and "in crash" in done.stderr
