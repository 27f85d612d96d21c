"""The pictures of a call, one after the other, as raw BGR frames into another program's pipe.

A window of FFmpeg, or a virtual camera that OBS and browsers see:

python examples/frame_loop.py call.rzo |
    ffplay -f rawvideo -pixel_format bgr24 -video_size 640x480 -
python examples/frame_loop.py call.rzo |
    ffmpeg -f rawvideo -pixel_format bgr24 -video_size 640x480 -i - -f v4l2 /dev/video9
"""

import sys
import time
from typing import BinaryIO

import risorius


def main(call: str, output: BinaryIO | None = None) -> None:
    pipe = output or sys.stdout.buffer
    with risorius.open_call(call) as pictures:
        begin = time.monotonic()
        for time_s, picture in pictures:
            time.sleep(max(0.0, begin + time_s - time.monotonic()))
            pipe.write(picture.tobytes())


if __name__ == "__main__":
    main(sys.argv[1])
