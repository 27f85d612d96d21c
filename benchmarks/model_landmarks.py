"""Landmarks that statistical models find without a network, against those of annotations.

    risorius annotate faces -o annotated                                  # by the landmark network
    python -m benchmarks model_landmarks annotated --model builtin model.npz

The outline of the face is left out.  --every looks at each N-th picture alone.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from aam.annotation.annotation_file import Annotation, read_annotations
from aam.annotation.landmark_search import ModelLandmarks
from aam.model_file import BUILTIN, named_model
from benchmarks.command import run
from encoder.detection.landmark_indices import FACE_OVAL, OUTER_EYE_CORNERS
from loopback.report import table
from shared_model.arrays import Array
from shared_model.errors import UserError

COLUMNS = ("annotations", "model", "pictures", "median, %", "below 5 %, %", "below 10 %, %")


def main(arguments: Sequence[str]) -> None:
    """Print a row for each folder and model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    parser.add_argument("--model", nargs="+", default=[BUILTIN], help=f"default: {BUILTIN}")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="default: 1")
    parsed = parser.parse_args(arguments)
    models = {name: ModelLandmarks(named_model(name)) for name in parsed.model}
    rows = list[list[str | float]]()
    for folder in parsed.folders:
        chosen = read_annotations(folder)[:: parsed.every]
        for name, model in models.items():
            off = np.array([distance_percent(model, each) for each in chosen])
            shares = [round(100 * float(np.mean(off < limit)), 1) for limit in (5, 10)]
            median = round(float(np.median(off)), 2)
            rows.append([folder.name, Path(name).stem, len(off), median, *shares])
    print(table(list(COLUMNS), rows))


def distance_percent(model: ModelLandmarks, annotation: Annotation) -> float:
    """Mean distance of a model's landmarks from those annotated, % of the eyes' distance.

    Infinite where no face is found.  Raises `UserError` if the picture is gone.
    """
    picture = cv2.imread(annotation.image, cv2.IMREAD_COLOR)
    if picture is None:
        raise UserError(f"cannot read {annotation.image}, the picture of {annotation.name}")
    found = model.find(np.asarray(picture, np.uint8))
    if found is None:
        return float("inf")
    known: Array = annotation.landmarks[:, :2].copy()
    known[list(FACE_OVAL)] = np.nan
    right, left = (annotation.landmarks[index, :2] for index in OUTER_EYE_CORNERS)
    away = np.linalg.norm(found[:, :2] - known, axis=1)
    return float(100 * np.nanmean(away) / np.linalg.norm(right - left))


if __name__ == "__main__":
    run(main)
