"""The command line: what the user asks for, handed to the parts that do it.

Only the standard library is imported here: a command loads what it needs, so that `--help` is
quick and an encoder host needs no renderer.
"""

import argparse
import errno
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

from risorius.command_line.arguments import BAD_USAGE, build_parser
from risorius.command_line.commands import INTERRUPTED
from shared_model.errors import UserError

BROKEN_PIPE = 141
# Libraries that only one end needs, and the extra that brings them.
EXTRA_OF = {"filterpy": "encoder", "moderngl": "decoder"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code; all that goes wrong is one line on stderr."""
    # Before numpy is loaded: sums must not depend on how many threads share them, or the same clip
    # would give other bytes on another host.  Products here are too small to gain by threads.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    _open_streams()
    try:
        arguments = build_parser().parse_args(argv)
        command: Callable[[argparse.Namespace], int] = arguments.run
        code = command(arguments)
        sys.stdout.flush()
        return code
    except UserError as error:
        return complain(str(error), error.exit_code)
    except ModuleNotFoundError as error:
        return complain(_missing(error), BAD_USAGE)
    except BrokenPipeError:
        _drop_output()
        return BROKEN_PIPE
    except OSError as error:
        # A full disk, a folder that went away: what no part of the program can do anything about.
        _drop_output()
        is_printed = error.filename is None and error.errno in (errno.ENOSPC, errno.EIO)
        told = f"cannot write what is printed: {error.strerror}" if is_printed else str(error)
        return complain(told, BAD_USAGE)
    except KeyboardInterrupt as interrupt:
        return complain(": ".join(["interrupted", *map(str, interrupt.args)]), INTERRUPTED)
    except SystemError as error:
        if not _is_interrupt(error):
            raise
        return complain("interrupted", INTERRUPTED)


def _open_streams() -> None:
    """Where they were closed by whoever started us: or else a file that is written takes their
    number, and gets what libraries say there."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))  # noqa: SIM115


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether an interrupt is behind an error: machine code that was being loaded hides it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _drop_output() -> None:
    """Python would flush stdout once more at exit and complain if nobody can take it."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def complain(message: str, code: int) -> int:
    """Say what went wrong in one line on stderr and return `code`."""
    with suppress(OSError):
        print(f"risorius: {' '.join(message.split())}", file=sys.stderr)
    return code


def _missing(error: ModuleNotFoundError) -> str:
    """What to install for a library that an extra brings; any other missing module is our fault."""
    library = (error.name or "").split(".")[0]
    if library not in EXTRA_OF:
        raise error
    extra = EXTRA_OF[library]
    return f"{library} is not installed; in the project's folder try: pip install '.[{extra}]'"
