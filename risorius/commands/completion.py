"""`risorius completion`: what makes a shell complete commands and options."""

import argparse
from typing import TYPE_CHECKING

from risorius.command_line.parser import add_command

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands, Parser

SHELLS = ("bash", "zsh", "tcsh")


def add_completion(added: "Commands", root: "Parser") -> None:
    """`risorius completion`.  root: the parser of all commands."""
    parser = add_command(
        added,
        "completion",
        "print what makes a shell complete commands and options",
        "Needs the extra `completion`.",
        "  risorius completion bash > ~/.local/share/bash-completion/completions/risorius\n"
        "  risorius completion zsh > ~/.zfunc/_risorius\n",
    )
    parser.add_argument("shell", choices=SHELLS, help="of which shell")
    parser.set_defaults(run=lambda arguments: run_completion(arguments, root))


def run_completion(arguments: argparse.Namespace, root: "Parser") -> int:
    """`risorius completion`."""
    import shtab

    print(shtab.complete(root, arguments.shell))
    return 0
