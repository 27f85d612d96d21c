"""`python -m decoder`: the same as `risorius decode`."""

import sys

if __name__ == "__main__":
    from risorius.command_line.cli import main

    sys.exit(main(["decode", *sys.argv[1:]]))
