"""Pictures as YUV4MPEG2, the raw video that players read from a pipe."""

from fractions import Fraction
from typing import BinaryIO

import cv2
import numpy as np

from decoder.sinks.interface import FrameSink
from shared_model.arrays import Picture, Single

# Weights of B', G', R' in Y' by BT.601 and BT.709.
LUMA_WEIGHTS = {"bt601": (0.114, 0.587, 0.299), "bt709": (0.0722, 0.7152, 0.2126)}
# Y'CbCr of video in 8 bits: black and no colour, and the spans of luma and colour over 255.
OFFSETS = (16, 128, 128)
LUMA_SPAN, COLOUR_SPAN = 219 / 255, 224 / 255


class Y4mStream(FrameSink):
    """A `FrameSink` that writes to an open stream, each picture at once.

    Pictures are 4:4:4 with 8 bits, of the source's colour matrix, which the format cannot state.
    The format has no sound.  The stream stays open, and replaces no older file.
    """

    def __init__(
        self,
        stream: BinaryIO,
        width: int,
        height: int,
        fps: Fraction,
        colour_matrix: str,
        sample_aspect: Fraction = Fraction(1),
    ) -> None:
        self._stream, self._shape = stream, (height, width, 3)
        self._ycbcr_from_bgr = ycbcr_from_bgr(colour_matrix)
        rate = f"{fps.numerator}:{fps.denominator}"
        aspect = f"{sample_aspect.numerator}:{sample_aspect.denominator}"
        self._write(f"YUV4MPEG2 W{width} H{height} F{rate} Ip A{aspect} C444\n".encode())

    def write(self, picture: Picture, time_s: Fraction | None = None) -> None:
        """Write one picture; the format has a constant rate.

        Raises `ValueError` if it is of another size.
        """
        if picture.shape != self._shape:
            raise ValueError(f"picture has shape {picture.shape}, expected {self._shape}")
        ycbcr = cv2.transform(picture.astype(np.float32), self._ycbcr_from_bgr)
        planes = np.clip(np.rint(ycbcr), 0, 255).astype(np.uint8).transpose(2, 0, 1)
        self._write(b"FRAME\n" + planes.tobytes())

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()


def ycbcr_from_bgr(colour_matrix: str) -> Single:
    """(3, 4) rows for Y', Cb and Cr of B, G, R in 0..255 and 1; in the range of video.

    Raises `ValueError` for a matrix that is not known.
    """
    if colour_matrix not in LUMA_WEIGHTS:
        known = ", ".join(LUMA_WEIGHTS)
        raise ValueError(f"colour_matrix is {colour_matrix!r}, expected one of {known}")
    luma = np.array(LUMA_WEIGHTS[colour_matrix])
    blue, _, red = np.eye(3)
    rows = [
        LUMA_SPAN * luma,
        COLOUR_SPAN * (blue - luma) / (2 * (1 - luma[0])),
        COLOUR_SPAN * (red - luma) / (2 * (1 - luma[2])),
    ]
    return np.column_stack([rows, OFFSETS]).astype(np.float32)
