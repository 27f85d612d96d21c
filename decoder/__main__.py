"""`python -m decoder`: the same as `risorius decode`."""

import sys

if __name__ == "__main__":
    from risorius.cli import main

    sys.exit(main(["decode", *sys.argv[1:]]))
