"""The experiments of thesis 2.4.4 and 3 on annotated faces: tables and plots.

    python -m benchmarks validate_aam --faces FACES -o out

annotates the folders imm, ytf and orl of FACES and runs all parts; or, of other annotations,

    python -m benchmarks validate_aam --train made/imm made/ytf --test made/orl -o out

Nobody in the test folders may be in the training folders.  --truth: folders of the same names with
annotations by given landmarks (`annotate --landmarks`), against which first frames are measured, by
models of the other half of the people; without it they are not.

A run that was stopped goes on where it was: a part whose table is there, made with the same
arguments, is passed over.  At the end stands what was asked and what all parts that are done have
reached, in asked.md.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.annotated_sets import AnnotatedSets, annotated_sets
from benchmarks.validate_aam.asked import asked_table
from benchmarks.validate_aam.experiments import PARTS, ROWS, run_experiments
from benchmarks.validate_aam.first_frames import read_true_pictures
from benchmarks.validate_aam.samples import read_samples

# Pictures of the test set at most, as many as in 3.1.
TEST_PICTURES = 124


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all experiments, or some; write and print each table as it is done."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--faces", type=Path, metavar="DIR", help="of imm, ytf and orl")
    parser.add_argument("--train", nargs="+", type=Path, default=[], metavar="DIR")
    parser.add_argument("--test", nargs="+", type=Path, default=[], metavar="DIR")
    parser.add_argument("--truth", nargs="*", type=Path, default=[], metavar="DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--size", type=int, default=64, choices=(64, 128))
    parser.add_argument(
        "--parts", nargs="+", default=PARTS, choices=PARTS, metavar="PART", help=", ".join(PARTS)
    )
    parsed = parser.parse_args(arguments)
    if (parsed.faces is None) != bool(parsed.train and parsed.test):
        parser.error("give --faces, or --train and --test")

    def tell(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    sets = AnnotatedSets(parsed.train, parsed.test, parsed.truth)
    if parsed.faces is not None:
        sets = annotated_sets(parsed.faces, parsed.output, tell)
    parsed.output.mkdir(parents=True, exist_ok=True)
    parts = unfinished_parts(parsed.output, parsed.parts, [str(sets), str(parsed.size)])
    train, test = read_samples(sets.train), read_samples(sets.test)
    chosen = np.linspace(0, len(test) - 1, min(len(test), TEST_PICTURES)).astype(int)
    samples = [test[i] for i in chosen]
    truth = read_true_pictures(sets.truth)
    parts = [part for part in parts if part != "first-frames" or truth]
    for name, content in run_experiments(train, samples, truth, parsed.size, parts, tell):
        write_whole(parsed.output / name, content)
        if isinstance(content, str) and name.endswith(".md") and not name.endswith(ROWS):
            print(content, flush=True)
    table = asked_table([path.read_text(encoding="utf-8") for path in row_files(parsed.output)])
    write_whole(parsed.output / "asked.md", table)
    print(table, flush=True)
    return 0


def row_files(output: Path) -> list[Path]:
    """The files of the parts that are done with their lines of the table, in the parts' order."""
    paths = (output / f"{part}{ROWS}" for part in PARTS)
    return [path for path in paths if path.exists() and path.with_name(done(path)).exists()]


def done(path: Path) -> str:
    """The name of the table that a finished part has.  path: of the part's file of lines."""
    return path.name.replace(ROWS, ".md")


def unfinished_parts(output: Path, parts: Sequence[str], arguments: Sequence[str]) -> list[str]:
    """The parts whose table is not in a folder; all, and no table stays, if those there were made
    with other arguments.
    """
    made_with, text = output / "arguments.json", json.dumps(arguments, indent=1)
    if not made_with.exists() or made_with.read_text(encoding="utf-8") != text:
        for part in PARTS:
            (output / f"{part}.md").unlink(missing_ok=True)
        write_whole(made_with, text)
    return [part for part in parts if not (output / f"{part}.md").exists()]


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that is there only when it is whole."""
    partial = path.with_name(f"{path.name}.part")
    partial.write_bytes(content.encode() if isinstance(content, str) else content)
    partial.replace(path)


if __name__ == "__main__":
    raise SystemExit(main())
