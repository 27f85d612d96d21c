"""A call over a link of one's own: anything that carries bytes, here a pipe between two threads.

python examples/link_of_your_own.py me.mp4
"""

import os
import sys
import threading

import risorius


def main(source: str, max_frames: int | None = None) -> int:
    receiving, sending = os.pipe()

    def send() -> None:
        with os.fdopen(sending, "wb") as wire:
            risorius.encode(source, wire, live=True, max_frames=max_frames)

    encoder = threading.Thread(target=send)
    encoder.start()
    shown = 0
    with os.fdopen(receiving, "rb") as wire, risorius.open_call(wire) as pictures:
        for _ in pictures:
            shown += 1
    encoder.join()
    print(f"{shown} pictures")
    return shown


if __name__ == "__main__":
    main(sys.argv[1])
