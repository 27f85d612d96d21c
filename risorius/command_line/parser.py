"""The parser that commands share: a mistake is one line, the help has examples and exit codes."""

import argparse
from typing import TYPE_CHECKING, NoReturn

from shared_model.errors import UserError

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction["Parser"]

BAD_USAGE = 2
INTERRUPTED = 130
EXIT_CODES = """\
exit codes:
  0    done; relay and view, and call once its page is there: stopped (Ctrl-C)
  1    a replayed clip missed a threshold
  2    bad usage or bad input: no such file, no call file, nowhere to write, no EGL
  3    no face found
  4    the link failed: port or call in use, no peer, or it broke; what came is written
  130  interrupted (Ctrl-C); what was done until then is written
  141  the reader of the output has closed it
"""


class Parser(argparse.ArgumentParser):
    """A parser that reports a mistake as a `UserError`."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; see {self.prog} --help", BAD_USAGE)


def add_command(added: "Commands", name: str, summary: str, details: str, examples: str) -> Parser:
    """Add the parser of a command; `summary` is its one line in the list of commands."""
    return added.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n\n{details}",
        epilog=f"examples:\n{examples}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        # `call --invite LINE` would be taken for --invite-file.
        allow_abbrev=False,
    )
