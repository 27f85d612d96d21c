"""The parser that commands share: a mistake is one line, the help has examples and exit codes."""

import argparse
import logging
import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NoReturn

from shared_model.errors import UserError
from shared_model.logs import log_to

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction["Parser"]

BAD_USAGE = 2
# A mistake of the program itself, as in sysexits.h; the variable that shows where it is.
INTERNAL_ERROR, TRACEBACK_VARIABLE = 70, "RISORIUS_TRACEBACK"
INTERRUPTED = 130
EXIT_CODES = """\
exit codes:
  0    done; relay and view, and call once its page is there: stopped (Ctrl-C)
  1    a replayed clip missed a threshold
  2    bad usage or bad input: no such file, no call file, nowhere to write, no EGL
  3    no face found
  4    the link failed: port or call in use, no peer, or it broke; what came is written
  70   the program itself failed; RISORIUS_TRACEBACK=1 shows where
  130  interrupted (Ctrl-C); what was done until then is written
  141  the reader of the output has closed it
"""


class Parser(argparse.ArgumentParser):
    """A parser that reports a mistake as a `UserError`, with what may have been meant."""

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """As `argparse` does, but a command reports its own unknown options."""
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown and self._subparsers is None:
            options = [word for word in unknown if word.startswith("-")]
            meant = _meant(options[:1], self._option_string_actions)
            self.error(f"unrecognized arguments: {' '.join(unknown)}{meant}")
        return parsed, unknown

    def error(self, message: str) -> NoReturn:
        choice = re.search(r"invalid choice: '(.+?)' \(choose from (.+)\)", message)
        if choice is not None:
            known = re.findall(r"[\w.-]+", choice[2])
            if meant := _meant([choice[1]], known):
                message = f"{message[: choice.start()]}invalid choice: '{choice[1]}'{meant}"
        raise UserError(f"{message}; see {self.prog} --help", BAD_USAGE)


def _meant(words: Sequence[str], known: Iterable[str]) -> str:
    """A question whether one of the known words was meant; empty if none is like the first."""
    close = [match for word in words for match in get_close_matches(word.split("=")[0], known, 1)]
    return f"; did you mean {close[0]}?" if close else ""


def add_command(added: "Commands", name: str, summary: str, details: str, examples: str) -> Parser:
    """Add the parser of a command; `summary` is its one line in the list of commands."""
    parser = added.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n\n{details}",
        epilog=f"examples:\n{examples}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        # `call --invite LINE` would be taken for --invite-file.
        allow_abbrev=False,
    )
    parser.add_argument(
        "-v",
        "--verbose",
        action="count",
        default=0,
        help="log on standard error what happens: -v what changes, -vv each packet",
    )
    parser.add_argument(
        "--log", metavar="FILE", help="log all of that into a file, added at its end"
    )
    return parser


def start_log(verbose: int, path: str | None) -> None:
    """Log as `-v` and `--log` say.  Raises `UserError` if the file cannot be written."""
    if verbose or path is not None:
        log_to(logging.INFO if verbose == 1 else logging.DEBUG, path)
