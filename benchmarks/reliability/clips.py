"""Clips that are long enough for a measurement."""

from itertools import cycle, islice
from pathlib import Path

import cv2

from encoder.capture.video_source import open_source

# Lossless.
CODEC = "FFV1"


def long_enough(clip: Path, least_s: float, folder: Path) -> Path:
    """The clip, or a video in `folder` that shows it forwards and backwards for `least_s`."""
    with open_source(str(clip)) as capture:
        fps, size = float(capture.fps), (capture.width, capture.height)
        pictures = [picture for _, picture in capture]
    count = round(least_s * fps)
    if count <= len(pictures):
        return clip
    longer = folder / f"{clip.stem}-{least_s:.0f}.mkv"
    if not longer.exists():
        writer = cv2.VideoWriter(str(longer), cv2.VideoWriter.fourcc(*CODEC), fps, size)
        for picture in islice(cycle([*pictures, *pictures[-2:0:-1]]), count):
            writer.write(picture)
        writer.release()
    return longer
