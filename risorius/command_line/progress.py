"""Progress of long jobs, messages and warnings, on the error stream."""

import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Self, TextIO

TERMINAL_INTERVAL_S = 0.1
LOG_INTERVAL_S = 10.0
BAR_WIDTH = 30


class ProgressLine:
    """A bar that redraws itself on a terminal; in a log a line every `LOG_INTERVAL_S`.

    Call it with the number of frames done and, if known, of all; leaving the `with` block ends it.
    """

    def __init__(
        self,
        label: str,
        stream: TextIO,
        quiet: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._label, self._stream, self._clock = label, stream, clock
        self._quiet = quiet
        self._is_terminal = stream.isatty()
        self._interval_s = TERMINAL_INTERVAL_S if self._is_terminal else LOG_INTERVAL_S
        self._start = clock()
        # A job that ends before the first interval gets no line in a log.
        self._next = self._start + (0 if self._is_terminal else self._interval_s)
        self._state: tuple[int, int | None] | None = None
        self._doing = ""
        self._has_line = False  # whether there is one on the terminal that is to be replaced

    def __call__(self, done: int, total: int | None) -> None:
        """Show that `done` of `total` frames are done; total None: not known."""
        self._state = done, total
        now = self._clock()
        if now >= self._next and not self._quiet:
            self._next = now + self._interval_s
            self._write(done, total)

    def preparing(self, what: str) -> None:
        """Show what the job prepares at the moment; "": nothing.

        It stands after the bar, or on a terminal alone where there is none yet.
        """
        self._doing = what
        if self._state is not None:
            if self._is_terminal:
                self._next = self._clock()
            self(*self._state)
        elif self._is_terminal and what and not self._quiet:
            self._has_line = True
            self._put(f"\r\x1b[K{self._label}: {what} ...")

    def say(self, line: str) -> None:
        """Write a line that stays, above the bar."""
        if self._quiet:
            return
        self._put(f"{self._erase}{self._label}: {line}\n")
        self._has_line = False

    def close(self) -> None:
        """Draw the last state and end the line."""
        if self._is_terminal and self._state is not None and not self._quiet:
            self._write(*self._state)
            self._put("\n")
        elif self._has_line:
            self._put(self._erase)
        self._state, self._has_line = None, False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def _erase(self) -> str:
        return "\r\x1b[K" if self._has_line else ""

    def _write(self, done: int, total: int | None) -> None:
        rate = done / max(self._clock() - self._start, 1e-6)
        text = f"{self._label} {_amount(done, total)} {rate:.0f}/s"
        if self._doing:
            text += f", {self._doing}"
        self._put(f"\r\x1b[K{text}" if self._is_terminal else f"{text}\n")
        self._has_line = self._is_terminal

    def _put(self, text: str) -> None:
        """Write; if the terminal was closed, write nothing more: the job goes on."""
        try:
            self._stream.write(text)
            self._stream.flush()
        except OSError:
            self._quiet = True


def say(message: str) -> None:
    """One line about the run, on stderr, if that still goes anywhere."""
    with suppress(OSError):
        print(message, file=sys.stderr, flush=True)


def warn(warnings: Iterable[str]) -> None:
    """Each warning as a line on stderr."""
    for warning in warnings:
        say(f"risorius: warning: {warning}")


def _amount(done: int, total: int | None) -> str:
    if not total:
        return f"{done} frames"
    filled = min(BAR_WIDTH, BAR_WIDTH * done // total)
    return f"|{'#' * filled}{'.' * (BAR_WIDTH - filled)}| {done}/{total}"
