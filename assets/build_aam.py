"""Build the statistical model that comes along, `aam/data/drawn_faces.npz`, from drawn faces.

    python -m assets.build_aam --output drawn_faces.npz

draws people who do not exist, annotates them by their true landmarks and trains on them: see the
README in that folder.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from aam.annotation.annotate import AnnotationOptions, annotate, list_images
from aam.model_file import write_model
from aam.training.faces import read_faces
from aam.training.train import TrainingOptions, train
from assets.build_head import PACKAGE
from assets.drawn_faces.__main__ import draw_people
from benchmarks.command import run, warn

# How many people, how fine a texture, and which share of the variance the modes keep.
PEOPLE, SIZE, RETAINED = 500, 64, 0.85


def main(arguments: Sequence[str]) -> None:
    """Draw, annotate, train."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--output", type=Path, required=True, metavar="NPZ", help="the model")
    parser.add_argument("--people", type=int, default=PEOPLE, help=f"default: {PEOPLE}")
    parser.add_argument(
        "--retained", type=float, default=RETAINED, help=f"of the variance; default: {RETAINED}"
    )
    parser.add_argument("--wheel", type=Path, help=f"of {PACKAGE}; downloaded if not given")
    options: Any = parser.parse_args(arguments)
    with TemporaryDirectory() as name:
        pictures, annotated = Path(name) / "drawn", Path(name) / "annotated"
        landmarks = draw_people(pictures, options.people, options.wheel)
        warn(f"{options.people} people are drawn")
        annotated.mkdir()
        given = AnnotationOptions(landmarks=str(landmarks))
        report = annotate(list_images([pictures]), annotated, given)
        faces = read_faces([annotated])
    for failure in report.failures:
        warn(failure)
    training = TrainingOptions(size=SIZE, retained=options.retained, regression=False)
    model = train(faces, training)
    write_model(options.output, model, compact=True)
    finest = model.levels[-1]
    counts = [len(part.variances) for part in (finest.shape, finest.texture, finest.combined)]
    warn(f"{len(faces)} faces: {counts} modes of shape, texture and both; {options.output}")


if __name__ == "__main__":
    run(main)
