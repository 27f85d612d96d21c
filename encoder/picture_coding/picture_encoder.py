"""Pictures of the model packet, coded: stills, textures and appearance modes.

A draft knows what a picture decodes to and what it costs; its bytes are made when it is sent.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.picture_coding.picture_rdoq import Tape, choose
from encoder.picture_coding.subband_rdoq import WORTH_A_TILE
from protocol.pictures.picture_codec import (
    ModeSeries,
    PictureFormat,
    serialise_head,
    step_size,
    to_planes,
)
from protocol.pictures.probability_model import STILL
from protocol.pictures.subband_coding import Series
from protocol.pictures.wavelet import LEVELS, transform
from protocol.pictures.weight_map import decode_relief

Array = NDArray[np.float64]
Single = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Draft:
    """A picture as it would be sent.

    colours: (h, w, 3) float32 BGR, what it decodes to.
    head: what comes before its coefficients, which are on the tape.
    """

    colours: Single
    head: bytes
    tape: Tape

    @property
    def size_bytes(self) -> int:
        """No less than it takes."""
        # One bit more, for what the coder's integers round.
        return len(self.head) + int(np.ceil((self.tape.bits + 1) / 8))

    def write(self) -> bytes:
        """Its bytes."""
        return self.head + self.tape.write()


def draft_still(colours: Single, step: int, relief: bytes = b"", kind: int = STILL) -> Draft:
    """A picture (h, w, 3), BGR 0..255, by itself.

    step: 0..MAX_STEP.  relief: see `protocol.pictures.weight_map`; none: equally fine everywhere.
    kind: `STILL` or `TEXTURE`.
    """
    height, width = colours.shape[:2]
    head = serialise_head(kind, width, height, relief)
    ours = PictureFormat(kind, decode_relief("still", relief, height, width))
    return _draft(Series(kind), ours, to_planes(colours, ours.chroma), step, head)


def draft_mode(modes: ModeSeries, planes: Single, step: int) -> Draft:
    """A mode (size, size, 3), as `to_planes` makes it, as the next of `modes`; they go on to it."""
    return _draft(modes.series, modes.format, planes, step)


def held_share(modes: ModeSeries, planes: Single, step: int) -> float:
    """About what share of a mode's energy its coded picture would hold at most."""
    whole = held = 0.0
    for rough, details in _coefficients(modes.format, planes, step):
        for band in (rough, *(band for level in details for band in level)):
            squares = band**2
            whole += float(squares.sum())
            held += float(squares[squares > WORTH_A_TILE**2].sum())
    return held / max(whole, 1e-9)


def _draft(
    series: Series, ours: PictureFormat, planes: Single, step: int, head: bytes = b""
) -> Draft:
    pyramids, tape = choose(series, _coefficients(ours, planes, step))
    return Draft(ours.colours(pyramids, step), head + bytes([step]), tape)


def _coefficients(
    ours: PictureFormat, planes: Single, step: int
) -> list[tuple[Array, list[list[Array]]]]:
    """Of each plane in steps, as `wavelet.transform` has them."""
    size = step_size(step)
    return [transform(plane / size, LEVELS) for plane in ours.planes(planes)]
