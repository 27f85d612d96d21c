"""How a video's display matrix turns and mirrors its pictures."""

import struct
from dataclasses import dataclass

import cv2
import numpy as np

from shared_model.arrays import Picture


@dataclass(frozen=True, slots=True)
class Orientation:
    """Rows and columns are exchanged first, where they are; then the sides are."""

    is_transposed: bool = False
    flips_columns: bool = False
    flips_rows: bool = False

    def apply(self, picture: Picture) -> Picture:
        """The picture (h, w, 3) as it is to be shown."""
        if self.is_transposed:
            picture = np.asarray(cv2.transpose(picture), np.uint8)
        if self.flips_columns or self.flips_rows:
            both = self.flips_columns and self.flips_rows
            picture = np.asarray(
                cv2.flip(picture, -1 if both else int(self.flips_columns)), np.uint8
            )
        return picture


UPRIGHT = Orientation()


def orientation_of(matrix: bytes | None) -> Orientation:
    """By a display matrix, which turns by multiples of 90 degrees and mirrors; None: as it is.

    The first two rows and columns of the matrix say where x and y go (`libavutil/display.h`).
    """
    if matrix is None:
        return UPRIGHT
    x_to_x, x_to_y, _, y_to_x, y_to_y = struct.unpack_from("<5i", matrix)
    if abs(x_to_y) > abs(x_to_x):
        return Orientation(True, flips_columns=y_to_x < 0, flips_rows=x_to_y < 0)
    return Orientation(False, flips_columns=x_to_x < 0, flips_rows=y_to_y < 0)
