"""`python -m encoder`: the same as `risorius encode`."""

import sys

if __name__ == "__main__":
    from risorius.cli import main

    sys.exit(main(["encode", *sys.argv[1:]]))
