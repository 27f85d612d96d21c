"""The experiments of thesis 2.4.4 and 3 on annotated faces: tables and plots.

    risorius annotate imm -o out/imm --person '([0-9]+)_'
    risorius annotate ytf -o out/ytf
    risorius annotate orl -o out/orl --person '(s[0-9]+)/'
    python -m benchmarks validate_aam --train out/imm out/ytf --test out/orl -o out

Nobody in the test folders may be in the training folders.  --truth: folders of the same names with
annotations by given landmarks (`annotate --landmarks`), against which first frames are measured, by
models of the other half of the people; without it they are not.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aam.validation.experiments import PARTS, run_experiments
from aam.validation.first_frames import read_true_pictures
from aam.validation.samples import read_samples

# Pictures of the test set at most, as many as in 3.1.
TEST_PICTURES = 124


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all experiments, or some; write and print each table as it is done."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--train", nargs="+", type=Path, required=True, metavar="DIR")
    parser.add_argument("--test", nargs="+", type=Path, required=True, metavar="DIR")
    parser.add_argument("--truth", nargs="*", type=Path, default=[], metavar="DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--size", type=int, default=64, choices=(64, 128))
    parser.add_argument(
        "--parts", nargs="+", default=PARTS, choices=PARTS, metavar="PART", help=", ".join(PARTS)
    )
    parsed = parser.parse_args(arguments)
    train, test = read_samples(parsed.train), read_samples(parsed.test)
    chosen = np.linspace(0, len(test) - 1, min(len(test), TEST_PICTURES)).astype(int)
    parsed.output.mkdir(parents=True, exist_ok=True)

    def tell(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    samples = [test[i] for i in chosen]
    truth = read_true_pictures(parsed.truth)
    parts = [part for part in parsed.parts if part != "first-frames" or truth]
    for name, text in run_experiments(train, samples, truth, parsed.size, parts, tell):
        (parsed.output / name).write_text(text, encoding="utf-8")
        if name.endswith(".md"):
            print(text, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
