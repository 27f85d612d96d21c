"""The experiments of thesis 2.4.4 and 3 on annotated faces: tables, plots, raw results.

    risorius annotate imm -o annotated/imm --person '([0-9]+)_'
    risorius annotate ytf -o annotated/ytf
    risorius annotate orl -o annotated/orl --person '(s[0-9]+)/'
    python -m scripts.validate_aam --train annotated/imm annotated/ytf --test annotated/orl -o out

Nobody in the test folders may be in the training folders.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aam.validation.experiments import run_experiments
from aam.validation.samples import read_samples

# Pictures of the test set at most, as many as in 3.1.
TEST_PICTURES = 124


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all experiments, or some, and write `tables.md` and the plots."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--train", nargs="+", type=Path, required=True, metavar="DIR")
    parser.add_argument("--test", nargs="+", type=Path, required=True, metavar="DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--size", type=int, default=64, choices=(64, 128))
    parsed = parser.parse_args(arguments)
    train, test = read_samples(parsed.train), read_samples(parsed.test)
    chosen = np.linspace(0, len(test) - 1, min(len(test), TEST_PICTURES)).astype(int)
    parsed.output.mkdir(parents=True, exist_ok=True)

    def tell(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    found = run_experiments(train, [test[i] for i in chosen], parsed.size, tell)
    for name, text in found.items():
        (parsed.output / name).write_text(text, encoding="utf-8")
    print(found["tables.md"])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
