"""Draw pictures of people who do not exist, with the landmarks of their faces.

    python -m assets.drawn_faces FOLDER --count 400
    risorius annotate FOLDER -o annotated --landmarks FOLDER/landmarks.csv
    risorius train annotated -o model.npz

Heads are mixtures of MakeHuman's CC0 targets, expressions those of the muscle model; skin, light
and camera are drawn at random.  The same number gives the same picture.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from assets.build_head import PACKAGE
from assets.drawn_faces.identities import Identities
from assets.drawn_faces.paint import draw_skin
from assets.drawn_faces.picture import DrawnFace, studio
from benchmarks.command import run
from runtime.parallel import parallel_map
from shared_model.mesh import generic_head

LANDMARKS = "landmarks.csv"


def main(arguments: Sequence[str]) -> None:
    """Draw the people."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("output", type=Path, help="folder for the pictures and landmarks.csv")
    parser.add_argument("--count", type=int, default=400, help="of people (default: 400)")
    parser.add_argument("--wheel", type=Path, help=f"of {PACKAGE}; downloaded if not given")
    options: Any = parser.parse_args(arguments)
    draw_people(options.output, options.count, options.wheel)


def draw_people(folder: Path, count: int, wheel: Path | None) -> Path:
    """Draw so many people into a folder; returns the file of their landmarks."""
    folder.mkdir(parents=True, exist_ok=True)
    identities, place = Identities(generic_head(), wheel), studio()

    def draw(number: int) -> DrawnFace:
        random = np.random.default_rng(number)
        return place.photograph(random, identities.draw(random), draw_skin(random))

    lines = ["name," + ",".join(f"x{i},y{i}" for i in range(468))]
    for number, face in enumerate(parallel_map(draw, range(count), None)):
        cv2.imwrite(str(folder / f"{number:04d}.png"), face.picture)
        row = ("" if np.isnan(value) else f"{value:.3f}" for value in face.landmarks.ravel())
        lines.append(",".join([f"{number:04d}", *row]))
    path = folder / LANDMARKS
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    run(main)
