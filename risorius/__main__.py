"""The program: `risorius`, or `python -m risorius`."""

import sys


def main() -> int:
    """Run the command of this process; returns its exit code."""
    try:
        from risorius.cli import main as run
    except KeyboardInterrupt:
        # Before the command line could say it.
        print("risorius: interrupted", file=sys.stderr)
        return 130
    return run()


if __name__ == "__main__":
    sys.exit(main())
