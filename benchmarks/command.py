"""How a program of this folder or of `assets` runs: errors are one line and an exit code."""

import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from risorius.cli import print_error
from risorius.command_line.parser import BAD_USAGE
from shared_model.errors import UserError

# Runs a command of the product as a process of its own.
PROGRAM = (sys.executable, "-m", "risorius")


def warn(message: str) -> None:
    """Print a warning of the encoder to standard error."""
    print(message, file=sys.stderr)


def run(main: Callable[[Sequence[str]], None]) -> NoReturn:
    """Run `main` on the command line's arguments and exit; a user's error is one line."""
    try:
        main(sys.argv[1:])
    except (UserError, OSError) as error:
        sys.exit(print_error(str(error), BAD_USAGE))
    sys.exit(0)
