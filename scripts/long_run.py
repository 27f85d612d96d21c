"""Whether a long call drifts: python -m scripts.long_run SOURCE DECODED

Prints the face PSNR (thesis eq. 6.1), dB, of each minute of a decoded call, and how much worse the
last full minute is than the first.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from encoder.capture import open_source
from loopback.quality import TrackedFaceArea, psnr_db, squared_error
from scripts.command import run


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("decoded")
    options = parser.parse_args(arguments)
    with open_source(options.source) as capture:
        a_minute = round(60 * capture.fps)
    figures = face_psnr_db(options.source, options.decoded)
    minutes = [figures[k : k + a_minute] for k in range(0, len(figures), a_minute)]
    for number, part in enumerate(minutes, 1):
        print(f"minute {number}: {np.nanmean(part):.2f} dB over {np.isfinite(part).sum()} frames")
    fall = np.nanmean(minutes[0]) - np.nanmean(figures[-a_minute:])
    print(f"last minute against the first: {-fall:+.2f} dB")


def face_psnr_db(source: str, decoded: str) -> list[float]:
    """Of each frame; nan where the source shows no face."""
    area, found = TrackedFaceArea(), []
    with open_source(source) as originals, open_source(decoded) as copies:
        for (_, original), (_, copy) in zip(originals, copies, strict=True):
            face = area(original)
            error = squared_error(original, copy)
            found.append(float("nan") if face is None else psnr_db(error[face]))
    return found


if __name__ == "__main__":
    run(main)
