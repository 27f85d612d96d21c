"""Pose and action units of a face, frame by frame, in a table.

python examples/track_to_csv.py me.mp4 me.csv
"""

import sys

import numpy as np

import risorius


def main(source: str, output: str) -> None:
    track = risorius.track(source)
    track.write_csv(output)
    smile = np.nan_to_num(track.action_units["AU12"])
    print(f"{len(smile)} frames; the broadest smile is in frame {int(smile.argmax())}")


if __name__ == "__main__":
    main(*sys.argv[1:])
