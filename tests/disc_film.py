"""A film of somebody before whom a disc is held, and what decoded pictures of it are worth."""

from pathlib import Path

import cv2
import numpy as np

from decoder.pipeline import DecodeOptions, DecodeReport, decode
from decoder.sinks.frame_sink import open_sink
from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source
from shared_model.arrays import Picture

FRAMES, BITRATE = 41, 12_000
# A disc that is held before the collar: frames in which it is there, place, and radius.
SEEN, X, Y, RADIUS = range(16, 32), 70, 118, 14


def make_disc_film(carphone: Path, path: Path) -> None:
    """Make the film of a clip of 176x144 pixels at 25/s."""
    with open_source(str(carphone)) as capture, open_sink(path, 176, 144, exact_fps(25)) as sink:
        for index, picture in capture:
            if index == FRAMES:
                break
            shown = picture.copy()
            if index in SEEN:
                cv2.circle(shown, (X, Y), RADIUS, (40, 200, 240), -1)
            sink.write(shown)


def pictures(path: Path) -> list[Picture]:
    with open_source(str(path)) as capture:
        return [picture for _, picture in capture]


def decoded(call: Path, folder: Path) -> tuple[list[Picture], DecodeReport]:
    output = folder / f"{call.stem}.mkv"
    report = decode(DecodeOptions(call, output=output), lambda *_: None, lambda: False)
    return pictures(output), report


def psnr(one: list[Picture], other: list[Picture]) -> float:
    difference = np.array(one, np.float64) - np.array(other)
    return float(10 * np.log10(255**2 / np.mean(difference**2)))


def around_disc(shown: list[Picture]) -> list[Picture]:
    area = slice(Y - RADIUS, Y + RADIUS), slice(X - RADIUS, X + RADIUS)
    return [shown[frame][area] for frame in SEEN]
