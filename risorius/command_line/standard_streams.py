"""Standard input and output as streams of bytes: a call or a video in a pipe."""

import os
import sys
from pathlib import Path
from typing import BinaryIO

from risorius.command_line.output_checks import STANDARD
from shared_model.errors import UserError


def input_of(path: Path | None) -> Path | BinaryIO | None:
    """The path, or standard input where it says so."""
    return sys.stdin.buffer if path == STANDARD else path


def output_of(path: Path | None) -> Path | BinaryIO | None:
    """The path, or standard output where it says so, see `take_output`."""
    return take_output() if path == STANDARD else path


def take_output() -> BinaryIO:
    """Standard output for bytes; what the program prints goes to standard error from now on.

    So does what a library writes there.  Raises `UserError` if it is a terminal.
    """
    if sys.stdout.isatty():
        raise UserError("standard output is a terminal; give a file name or a pipe instead of -")
    sys.stdout.flush()
    taken = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return os.fdopen(taken, "wb", buffering=0)
