"""A call file of a video, what it weighs, and a video of it again.

python examples/encode_and_decode.py me.mp4 [FOLDER]
"""

import sys
from pathlib import Path

import cv2

import risorius


def main(source: str, folder: str = ".") -> None:
    call = Path(folder) / "call.rzo"
    report = risorius.encode(source, call)
    summary = risorius.info(call)
    rate = f"{summary.model_bytes} bytes, then {summary.frame_bps:.0f} bit/s"
    print(f"{report.frames} frames: {rate}")
    with risorius.open_call(call) as pictures:
        for number, (time_s, picture) in enumerate(pictures):
            if number % 25 == 0:
                path = Path(folder) / f"at_{time_s:.2f}_s.png"
                cv2.imwrite(str(path), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
