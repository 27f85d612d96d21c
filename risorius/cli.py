"""The command line: arguments -> command -> exit code; an error is one line on stderr.

A command imports what it needs only when it runs: `--help` is quick, and an encoder host needs no
renderer.
"""

import argparse
import errno
import faulthandler
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import NoReturn

from risorius.command_line.parser import (
    BAD_USAGE,
    EXIT_CODES,
    INTERNAL_ERROR,
    INTERRUPTED,
    TRACEBACK_VARIABLE,
    Parser,
    start_log,
)
from risorius.commands.annotate import add_annotate
from risorius.commands.benchmarks import add_bench, add_replay
from risorius.commands.call import add_call
from risorius.commands.calls import add_calls
from risorius.commands.compare import add_compare
from risorius.commands.completion import add_completion
from risorius.commands.decode import add_decode
from risorius.commands.drawing import add_animate, add_view
from risorius.commands.encode import add_encode
from risorius.commands.first_steps import add_compile, add_demo
from risorius.commands.info import add_info
from risorius.commands.keys import add_invite, add_keys
from risorius.commands.letter import add_letter
from risorius.commands.relay import add_relay
from risorius.commands.track import add_track
from risorius.commands.train import add_train
from shared_model.errors import UserError

BROKEN_PIPE = 141
COMMANDS = (
    add_call,
    add_encode,
    add_decode,
    add_letter,
    add_calls,
    add_relay,
    add_invite,
    add_keys,
    add_compare,
    add_bench,
    add_replay,
    add_info,
    add_track,
    add_annotate,
    add_train,
    add_animate,
    add_view,
    add_demo,
    add_compile,
)
DESCRIPTION = """\
A videophone that sends a face as muscles, not pixels: one model packet that says who it is, then
800 bits a second that say how the face moves.
"""
EXAMPLES = """\
examples:
  risorius demo                                 a call from end to end, on a clip that is at hand
  risorius call --listen :7447                  wait for somebody to call, in a browser; then
  risorius call risorius://...                  on the other host, with the line it has printed
  risorius encode me.mp4 -o call.rzo            record a call
  risorius info call.rzo                        see what it weighs
  risorius decode call.rzo -o out.mkv           make it a video again
  risorius letter me.mp4 -o me.html             one file that any browser plays, offline
  risorius decode --listen :7447 -o out.mkv     on one host: it prints an invitation; then
  risorius encode 0 --invite risorius://...     on the other: a call with camera 0
  risorius track me.mp4 -o me.csv               pose and expression, frame by frame
  risorius view --call call.rzo                 move every muscle of the face by hand
  risorius bench me.mp4 --out out/bench         bits against PSNR, two processes on this host
"""
# Libraries that only one end needs, and the extra that brings them.
EXTRA_OF = {
    "ai_edge_litert": "encoder",
    "aiohttp": "call",
    "filterpy": "encoder",
    "moderngl": "decoder",
    "segno": "call",
    "serial": "serial",
    "shtab": "completion",
    "threadpoolctl": "encoder",
}


class ShowVersion(argparse.Action):
    """Prints the installed version and exits."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *values: object) -> NoReturn:
        from importlib.metadata import PackageNotFoundError, version

        try:
            print(f"risorius {version('risorius')}")
        except PackageNotFoundError:
            print("risorius (not installed)")
        parser.exit()


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code; an error is one line on stderr.

    argv: None: those of this process, which ends after the command.
    """
    code = _run(argv)
    if argv is None:
        _end_now_if_linked(code)
    return code


def _end_now_if_linked(code: int) -> None:
    """End the process if threads are still in Zenoh, without waiting: Python would abort if one of
    them returned during its shutdown.
    """
    sessions = sys.modules.get("protocol.link.zenoh_session")
    if sessions is not None and sessions.is_busy():
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)


def _run(argv: Sequence[str] | None) -> int:
    # Before numpy is loaded: sums that several threads share depend on their number, and the same
    # clip would give other bytes on another host.  Matrix products here are too small for threads.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    _open_streams()
    # A crash of a library says where it happened.
    if not faulthandler.is_enabled() and sys.__stderr__ is not None:
        faulthandler.enable(sys.__stderr__)
    try:
        arguments = build_parser().parse_args(argv)
        start_log(arguments.verbose, arguments.log)
        command: Callable[[argparse.Namespace], int] = arguments.run
        code = command(arguments)
        sys.stdout.flush()
        return code
    except UserError as error:
        return print_error(str(error), error.exit_code)
    except ModuleNotFoundError as error:
        return print_error(_missing(error), BAD_USAGE)
    except BrokenPipeError:
        _drop_output()
        return BROKEN_PIPE
    except OSError as error:
        # A full disk, a folder that was removed: no part of the program can mend it.
        _drop_output()
        is_printed = error.filename is None and error.errno in (errno.ENOSPC, errno.EIO)
        told = f"cannot write what is printed: {error.strerror}" if is_printed else str(error)
        return print_error(told, BAD_USAGE)
    except KeyboardInterrupt as interrupt:
        return print_error(": ".join(["interrupted", *map(str, interrupt.args)]), INTERRUPTED)
    except SystemError as error:
        if not _is_interrupt(error):
            return _print_failure(error)
        return print_error("interrupted", INTERRUPTED)
    except Exception as error:
        return _print_failure(error)


def _print_failure(error: Exception) -> int:
    """Report a mistake of the program itself; returns the exit code."""
    if os.environ.get(TRACEBACK_VARIABLE):
        traceback.print_exception(error)
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    told = f"internal error, {reason}; with {TRACEBACK_VARIABLE}=1 it says where"
    return print_error(told, INTERNAL_ERROR)


def build_parser() -> Parser:
    """The parser of all commands; each sets `run`, which takes the parsed arguments."""
    parser = Parser(
        prog="risorius",
        description=DESCRIPTION,
        epilog=f"{EXAMPLES}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=ShowVersion, help="print the version")
    parser.set_defaults(run=lambda arguments: _print_help(parser), verbose=0, log=None)
    added = parser.add_subparsers(title="commands", metavar="COMMAND")
    for add in COMMANDS:
        add(added)
    add_completion(added, parser)
    return parser


def _print_help(parser: Parser) -> int:
    parser.print_help()
    return 0


def _open_streams() -> None:
    """Open standard streams that the parent process has closed.

    A file would take the number of a closed one, and what libraries print would go into that file.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))  # noqa: SIM115


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether an interrupt caused the error: an interrupt while machine code loads is replaced."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _drop_output() -> None:
    """Connect stdout to nothing: Python flushes it at exit and reports an error if it fails."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_error(message: str, code: int) -> int:
    """Say what went wrong in one line on stderr and return `code`."""
    with suppress(OSError):
        print(f"risorius: {' '.join(message.split())}", file=sys.stderr)
    return code


def _missing(error: ModuleNotFoundError) -> str:
    """What to install for a library that an extra brings; any other missing module is our fault."""
    library = (error.name or "").split(".")[0]
    if library not in EXTRA_OF:
        raise error
    # All that is missing at once: who installs one extra after the other loses patience.
    absent = [each for each in EXTRA_OF if find_spec(each) is None and each != "shtab"]
    extras = ",".join(dict.fromkeys(EXTRA_OF[each] for each in (library, *absent)))
    return f"{library} is not installed; in the project's folder try: pip install '.[{extras}]'"
