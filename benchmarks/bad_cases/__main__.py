"""Cases that layers cannot show: python -m benchmarks bad_cases SOURCE SHEET.jpg [--frames N]

Makes cases of a video of one person: a camera that moves, light that is switched on, a hand before
the face, a second person, one who leaves and comes back, a chair behind the head.  Each is encoded
and decoded; the sheet has a row for each, three times source and decoded picture side by side.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmarks.command import run
from decoder.pipeline import DecodeOptions, decode
from encoder.capture.video_source import open_source
from encoder.detection.segmentation import person_probability
from encoder.detection.tflite import find_segmentation_network
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from shared_model.arrays import Picture, Single
from shared_model.errors import UserError

FRAMES = 48
# When pictures of the sheet are taken, in the length of a case; height of a row, pixels.
TIMES, ROW_PX = (0.08, 0.5, 0.92), 144
CHAIR_BGR, HAND_BGR = (40, 60, 90), (110, 140, 200)


@dataclass(frozen=True, slots=True)
class Case:
    """A bad case.  picture: makes its picture of a source picture and the time, 0 to 1."""

    name: str
    picture: Callable[[Picture, float], Picture]


def moving_camera(picture: Picture, time: float) -> Picture:
    """The camera sways by a tenth of the picture and zooms a little."""
    height, width = picture.shape[:2]
    zoom = 1.15 + 0.05 * np.sin(5 * time)
    shift = np.array([0.05 * np.sin(9 * time), 0.03 * np.cos(7 * time)]) * (width, height)
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), 2 * np.sin(6 * time), zoom)
    matrix[:, 2] += shift
    return np.asarray(cv2.warpAffine(picture, matrix, (width, height)), np.uint8)


def light_switched_on(picture: Picture, time: float) -> Picture:
    """Dark until a third of the time has passed."""
    return np.asarray(picture * (0.3 if time < 0.34 else 1.0), np.uint8)


def hand_before_the_face(picture: Picture, time: float) -> Picture:
    """A hand crosses the picture from .3 to .7 of the time."""
    height, width = picture.shape[:2]
    if not 0.3 < time < 0.7:
        return picture
    drawn = picture.copy()
    centre = int(width * (time - 0.3) / 0.4), int(0.5 * height)
    cv2.ellipse(drawn, centre, (width // 9, height // 4), 20, 0, 360, HAND_BGR, -1, cv2.LINE_AA)
    return drawn


def two_people(picture: Picture, time: float) -> Picture:
    """The person twice, once mirrored."""
    return np.hstack([picture, picture[:, ::-1]])


def leaves_and_comes_back(picture: Picture, time: float) -> Picture:
    """Out of the picture to the left, for some of the time in its middle."""
    height, width = picture.shape[:2]
    away = float(np.interp(time, [0.25, 0.4, 0.6, 0.75], [0.0, 1, 1, 0]))
    share = _share_of_person(picture)
    hidden = cv2.dilate((share > 0.2).astype(np.uint8), np.ones((9, 9), np.uint8))
    empty = cv2.inpaint(picture, hidden, 3, cv2.INPAINT_TELEA)
    matrix = np.array([[1, 0, -away * width], [0, 1, 0.0]])
    layers = np.dstack([picture, share]).astype(np.float32)
    moved = np.asarray(cv2.warpAffine(layers, matrix, (width, height)))
    alpha = moved[..., 3:]
    return np.asarray(alpha * moved[..., :3] + (1 - alpha) * empty, np.uint8)


def chair_behind_the_head(picture: Picture, time: float) -> Picture:
    """A dark back of a chair behind the person, wider than the head."""
    height, width = picture.shape[:2]
    share = _share_of_person(picture)[..., None]
    chair = picture.copy()
    corner, other = (width // 4, height // 5), (width * 3 // 4, height)
    cv2.rectangle(chair, corner, other, CHAIR_BGR, -1)
    return np.asarray(share * picture + (1 - share) * chair, np.uint8)


def _share_of_person(picture: Picture) -> Single:
    """(h, w) 0..1 of each pixel.  Raises `UserError` without the segmentation network."""
    path = find_segmentation_network()
    if path is None:
        raise UserError("the cases need the segmentation network")
    share = cv2.resize(person_probability(path, picture), picture.shape[1::-1])
    return np.asarray(share, np.float32)


CASES = (
    Case("moving camera", moving_camera),
    Case("light switched on", light_switched_on),
    Case("hand before the face", hand_before_the_face),
    Case("two people", two_people),
    Case("leaves and comes back", leaves_and_comes_back),
    Case("chair behind the head", chair_behind_the_head),
)


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--frames", type=int, default=FRAMES)
    options = parser.parse_args(arguments)
    with open_source(options.source) as capture:
        frames = [frame for _, frame in islice(capture, options.frames)]
    rows = []
    for case in CASES:
        rows.append(row_of(case, frames))
        print(case.name, flush=True)
    if not cv2.imwrite(str(options.sheet), sheet_of(rows)):
        raise UserError(f"cannot write {options.sheet}")


def sheet_of(rows: Sequence[Picture]) -> Picture:
    """The rows below one another, as wide as the narrowest."""
    width = min(row.shape[1] for row in rows)
    sizes = [(width, round(row.shape[0] * width / row.shape[1])) for row in rows]
    scaled = [
        np.pad(cv2.resize(row, size, interpolation=cv2.INTER_AREA), ((0, 4), (0, 0), (0, 0)))
        for row, size in zip(rows, sizes, strict=True)
    ]
    return np.asarray(np.vstack(scaled), np.uint8)


def row_of(case: Case, frames: Sequence[Picture]) -> Picture:
    """(ROW_PX, w, 3) source and decoded picture of a case at some times."""
    count = len(frames)
    source = [case.picture(frame, i / count) for i, frame in enumerate(frames)]
    with TemporaryDirectory() as folder:
        for i, picture in enumerate(source):
            cv2.imwrite(f"{folder}/source_{i:04d}.png", picture)
        call, shown = Path(folder, "call.rzo"), Path(folder, "shown_%04d.png")
        options = EncodeOptions(f"{folder}/source_%04d.png", call)
        encode(options, lambda done, total: None, lambda: False)
        decode(DecodeOptions(call, output=shown), lambda done, total: None, lambda: False)
        paths = sorted(Path(folder).glob("shown_*.png"))
        decoded = [np.asarray(cv2.imread(str(path)), np.uint8) for path in paths]
    pairs = [(source[round(time * count)], decoded[round(time * count)]) for time in TIMES]
    shape = source[0].shape
    size = round(shape[1] * ROW_PX / shape[0]), ROW_PX
    pictures = [cv2.resize(each, size) for pair in pairs for each in pair]
    return np.hstack([np.asarray(picture, np.uint8) for picture in pictures])


if __name__ == "__main__":
    run(main)
