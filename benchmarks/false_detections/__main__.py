"""How often a face is found where there is none: in drawn pictures, and in the frames of a video.

    python -m benchmarks false_detections [--model model.npz] [--frames foreman.264 --from 200]

The drawn pictures are noise, stripes, checks, gradients, polygons, letters, and discs in pairs that
look a little like eyes.  Found by the landmark network, by Viola-Jones, and by Viola-Jones and a
model of `risorius train` that has to explain what was found.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.annotation.landmark_search import ModelLandmarks, StillLandmarks
from aam.model_file import read_model
from benchmarks.command import run
from encoder.capture.video_source import open_source
from encoder.detection.viola_jones import HaarDetector
from shared_model.arrays import Picture

Colour = tuple[int, int, int]

PICTURES, SIDE = 400, 256
SEED = 1


def drawn_pictures(count: int, random: np.random.Generator) -> Iterator[Picture]:
    """Pictures (SIDE, SIDE, 3) without a face, of each kind in turn."""
    for number in range(count):
        picture = KINDS[number % len(KINDS)](random)
        yield np.asarray(np.clip(picture, 0, 255), np.uint8)


def _noise(random: np.random.Generator) -> NDArray[np.generic]:
    cells = int(random.integers(4, SIDE))
    noise = random.integers(0, 256, (cells, cells, 3)).astype(np.float32)
    return np.asarray(cv2.resize(noise, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC))


def _gradient(random: np.random.Generator) -> NDArray[np.generic]:
    ends = random.uniform(0, 255, (2, 2, 3)).astype(np.float32)
    return np.asarray(cv2.resize(ends, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR))


def _stripes(random: np.random.Generator) -> NDArray[np.generic]:
    y, x = np.mgrid[:SIDE, :SIDE]
    waves = np.zeros((SIDE, SIDE))
    for _ in range(int(random.integers(1, 4))):
        angle, length = random.uniform(0, np.pi), random.uniform(8, 120)
        waves += np.sin(2 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / length)
    return 128 + 50 * waves[..., None] * random.uniform(0.3, 1, 3)


def _checks(random: np.random.Generator) -> NDArray[np.generic]:
    y, x = np.mgrid[:SIDE, :SIDE] // int(random.integers(4, 64))
    colours = random.uniform(0, 255, (2, 3))
    return np.asarray(colours[(x + y) % 2])


def _polygons(random: np.random.Generator) -> NDArray[np.generic]:
    picture = np.full((SIDE, SIDE, 3), random.uniform(0, 255, 3))
    for _ in range(int(random.integers(3, 20))):
        corners = random.integers(0, SIDE, (int(random.integers(3, 7)), 1, 2))
        cv2.fillPoly(picture, [corners], _colour(random))
    return picture


def _letters(random: np.random.Generator) -> NDArray[np.generic]:
    picture = np.full((SIDE, SIDE, 3), random.uniform(0, 255, 3))
    for row in range(20, SIDE, int(random.integers(15, 40))):
        text = "".join(map(chr, random.integers(33, 127, 30)))
        scale = float(random.uniform(0.4, 1.5))
        cv2.putText(picture, text, (5, row), cv2.FONT_HERSHEY_SIMPLEX, scale, _colour(random), 2)
    return picture


def _discs(random: np.random.Generator) -> NDArray[np.generic]:
    """Two dark discs and a stroke on an ellipse, all askew: no more than a hint of a face."""
    picture = np.full((SIDE, SIDE, 3), random.uniform(0, 255, 3))
    centre = (int(random.integers(90, 166)), int(random.integers(90, 166)))
    axes = (int(random.integers(40, 90)), int(random.integers(40, 90)))
    cv2.ellipse(picture, centre, axes, float(random.uniform(0, 180)), 0, 360, _colour(random), -1)
    for _ in range(2):
        at = np.array(centre) + random.integers(-40, 41, 2)
        cv2.circle(picture, at.tolist(), int(random.integers(4, 16)), (20, 20, 20), -1)
    end = np.array(centre) + random.integers(-40, 41, 2)
    cv2.line(picture, centre, end.tolist(), (40, 30, 60), int(random.integers(2, 8)))
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), float(random.uniform(0.5, 4))))


def _colour(random: np.random.Generator) -> Colour:
    blue, green, red = random.integers(0, 256, 3).tolist()
    return blue, green, red


KINDS = (_noise, _gradient, _stripes, _checks, _polygons, _letters, _discs)


def main(arguments: Sequence[str]) -> None:
    """Print how many pictures show a face to each detector."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--frames", metavar="VIDEO")
    parser.add_argument("--from", dest="first", type=int, default=0, metavar="FRAME")
    parsed = parser.parse_args(arguments)
    network, haar = StillLandmarks(), HaarDetector()
    finders: dict[str, Callable[[Picture], bool]] = {
        "landmark network": lambda picture: network.find(picture) is not None,
        "Viola-Jones": lambda picture: bool(haar.detect(picture)),
    }
    if parsed.model is not None:
        by_model = ModelLandmarks(read_model(parsed.model))
        finders["Viola-Jones + AAM"] = lambda picture: by_model.find(picture) is not None
    if parsed.frames is None:
        pictures = list(drawn_pictures(PICTURES, np.random.default_rng(SEED)))
    else:
        with open_source(parsed.frames) as capture:
            pictures = [frame for _, frame in islice(capture, parsed.first, None)]
    for name, finds in finders.items():
        print(f"{name}: {sum(map(finds, pictures))} of {len(pictures)}")


if __name__ == "__main__":
    run(main)
