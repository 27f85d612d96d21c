"""`python -m risorius`: the same as `risorius`."""

import sys

if __name__ == "__main__":
    from risorius.cli import main

    sys.exit(main())
