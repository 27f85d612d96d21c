"""A recorded call, drawn with the face of another one.

python examples/face_of_another.py call.rzo other.rzo out.avi
"""

import sys

import cv2

import risorius


def main(call: str, face: str, output: str) -> None:
    writer = None
    with risorius.open_call(call, face=face) as pictures:
        for _, picture in pictures:
            if writer is None:
                size = picture.shape[1], picture.shape[0]
                writer = cv2.VideoWriter(output, cv2.VideoWriter.fourcc(*"MJPG"), 25, size)
            writer.write(picture)
    if writer is not None:
        writer.release()


if __name__ == "__main__":
    main(*sys.argv[1:])
