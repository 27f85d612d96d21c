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
from numpy.typing import NDArray

from aam.annotation.annotation_file import read_header
from aam.validation.experiments import run_experiments
from aam.validation.samples import Sample, read_samples
from shared_model.errors import UserError

# Pictures of the test set at most, as many as in 3.1.
TEST_PICTURES = 124


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all experiments, or some, and write `tables.md` and the plots."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--train", nargs="+", type=Path, required=True, metavar="DIR")
    parser.add_argument("--test", nargs="+", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="NPZ",
        help="landmarks (n, 468, 2) `xy` of the test pictures `name`, instead of the annotation's",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--size", type=int, default=64, choices=(64, 128))
    parsed = parser.parse_args(arguments)
    train, test = read_samples(parsed.train), read_samples(parsed.test)
    if parsed.truth is not None:
        test = [_with_truth(sample, parsed.test, parsed.truth) for sample in test]
    chosen = np.linspace(0, len(test) - 1, min(len(test), TEST_PICTURES)).astype(int)
    parsed.output.mkdir(parents=True, exist_ok=True)

    def tell(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    found = run_experiments(train, [test[i] for i in chosen], parsed.size, tell)
    for name, text in found.items():
        (parsed.output / name).write_text(text, encoding="utf-8")
    print(found["tables.md"])
    return 0


def _with_truth(sample: Sample, folders: Sequence[Path], truth: Path) -> Sample:
    folder, name = sample.face.name.split("/")
    path = next(each for each in folders if each.name == folder) / f"{name}.json"
    image = str(read_header(path)["image"])
    points = _points_of(truth, image)
    return Sample(sample.face, sample.face.window.to_window(points))


def _points_of(truth: Path, image: str) -> NDArray[np.float64]:
    with np.load(truth, allow_pickle=False) as data:
        for number, name in enumerate(data["name"]):
            if image.endswith(str(name)):
                return np.asarray(data["xy"][number], float)
    raise UserError(f"{truth} has no landmarks of {image}")


if __name__ == "__main__":
    raise SystemExit(main())
