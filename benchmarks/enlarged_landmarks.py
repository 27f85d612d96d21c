"""Landmarks of small pictures for `risorius annotate --landmarks FILE.csv`.

    python -m benchmarks enlarged_landmarks orl -o orl.csv

The landmark network finds them in pictures enlarged four times, more than `annotate` enlarges.
"""

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from aam.annotation.annotate import list_images
from aam.annotation.landmark_search import StillLandmarks
from benchmarks.command import run, warn
from shared_model.arrays import Array
from shared_model.errors import UserError

ENLARGEMENT = 4


def main(arguments: Sequence[str]) -> None:
    """Write the landmarks of all pictures that show a face."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("images", nargs="+", type=Path, metavar="IMAGE")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.csv")
    parsed = parser.parse_args(arguments)
    network, images = StillLandmarks(), list_images(parsed.images)
    with parsed.output.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["file", *(f"{axis}{i}" for i in range(468) for axis in "xy")])
        for path in images:
            points = enlarged_landmarks(network, path)
            if points is None:
                warn(f"{path}: no face found")
            else:
                name = f"{path.parent.name}/{path.name}"
                writer.writerow([name, *(f"{value:.3f}" for value in points.ravel())])


def enlarged_landmarks(network: StillLandmarks, path: Path) -> Array | None:
    """(468, 2) pixels of the picture, None without a face.  Raises `UserError`."""
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise UserError(f"cannot read {path}: not a picture that can be read")
    large = cv2.resize(picture, None, fx=ENLARGEMENT, fy=ENLARGEMENT, interpolation=cv2.INTER_CUBIC)
    found = network.find(np.asarray(large, np.uint8))
    return None if found is None else (found[:, :2] + 0.5) / ENLARGEMENT - 0.5


if __name__ == "__main__":
    run(main)
