"""PSNR over the minutes of a long call.

    python -m benchmarks long_run SOURCE DECODED [--after SECONDS]

Prints the mean face PSNR (thesis eq. 6.1), dB, of each minute of a decoded call; with --after also
that of the call without its first SECONDS; and from two minutes on the difference between the last
and the first 60 seconds.
"""

import argparse
from collections.abc import Sequence
from itertools import zip_longest

import numpy as np

from benchmarks.command import run
from encoder.capture.video_source import open_source
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.video_quality import TrackedFaceMask
from risorius.command_line.argument_types import seconds
from shared_model.errors import UserError


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("decoded")
    parser.add_argument(
        "--after",
        type=seconds,
        metavar="SECONDS",
        help="say the mean without the first SECONDS, too",
    )
    options = parser.parse_args(arguments)
    with open_source(options.source) as capture:
        fps = float(capture.fps)
    print(
        "\n".join(summary_lines(face_psnr_db(options.source, options.decoded), fps, options.after))
    )


def summary_lines(figures: Sequence[float], fps: float, after_s: float | None = None) -> list[str]:
    """The lines to print of the PSNR of each frame, dB.  after_s: see --after."""
    a_minute = round(60 * fps)
    starts = range(0, len(figures), a_minute)
    parts = {f"minute {number}": figures[k : k + a_minute] for number, k in enumerate(starts, 1)}
    if after_s is not None:
        parts[f"after {after_s:g} s"] = figures[round(after_s * fps) :]
    lines = [
        f"{name}: {_mean(part):.2f} dB over {_count(part)} frames" for name, part in parts.items()
    ]
    if len(figures) >= 2 * a_minute:
        change = _mean(figures[-a_minute:]) - _mean(figures[:a_minute])
        lines.append(f"last minute against the first: {change:+.2f} dB")
    return lines


def _count(figures: Sequence[float]) -> int:
    return int(np.isfinite(figures).sum())


def _mean(figures: Sequence[float]) -> float:
    return float(np.nanmean(figures)) if _count(figures) else float("nan")


def face_psnr_db(source: str, decoded: str) -> list[float]:
    """The PSNR of each frame, dB; nan where the source shows no face.

    Raises `UserError` if one of the videos ends before the other.
    """
    area, found = TrackedFaceMask(), list[float]()
    with open_source(source) as originals, open_source(decoded) as copies:
        for first, second in zip_longest(originals, copies):
            if first is None or second is None:
                shorter = source if first is None else decoded
                raise UserError(f"{shorter} ends after {len(found)} frames, the other does not")
            (_, original), (_, copy) = first, second
            face = area(original)
            error = squared_error(original, copy)
            found.append(float("nan") if face is None else psnr_db(error[face]))
    return found


if __name__ == "__main__":
    run(main)
