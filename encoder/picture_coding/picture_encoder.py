"""Wavelet pictures of the model packet, encoded: backgrounds, textures and appearance modes.

An `EncodedPicture` knows its decoded picture and its size; the range coder runs only when it is
serialised.
"""

from dataclasses import dataclass

import numpy as np

from encoder.picture_coding.picture_rdoq import SymbolBuffer, quantise_picture
from encoder.picture_coding.subband_rdoq import TILE_THRESHOLD
from protocol.pictures.picture_codec import (
    ModeCodec,
    PictureFormat,
    serialise_picture_header,
    step_size,
    to_planes,
)
from protocol.pictures.probability_model import BACKGROUND
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.wavelet import LEVELS, transform
from protocol.pictures.weight_map import decode_weight_map
from shared_model.arrays import Array, Single


@dataclass(frozen=True, slots=True)
class EncodedPicture:
    """A quantised picture.

    decoded: (h, w, 3) float32 BGR, the picture that a decoder has of it.
    header: the bytes before its coefficients.  symbols: its coefficients.
    """

    decoded: Single
    header: bytes
    symbols: SymbolBuffer

    @property
    def size_bytes(self) -> int:
        """An upper bound of the serialised size."""
        # The range coder's integer arithmetic costs less than one bit.
        return len(self.header) + int(np.ceil((self.symbols.bits + 1) / 8))

    def serialise(self) -> bytes:
        """The picture's bytes."""
        return self.header + self.symbols.serialise()


def encode_picture(
    colours: Single, step: int, weight_map: bytes = b"", kind: int = BACKGROUND
) -> EncodedPicture:
    """Encode one picture (h, w, 3), BGR 0..255, without reference to others.

    step: index of the quantiser step, 0..MAX_STEP.
    weight_map: see `protocol.pictures.weight_map`; empty: the same quantiser everywhere.
    kind: `BACKGROUND` or `TEXTURE`.
    """
    height, width = colours.shape[:2]
    header = serialise_picture_header(kind, width, height, weight_map)
    picture_format = PictureFormat(kind, decode_weight_map("picture", weight_map, height, width))
    planes = to_planes(colours, picture_format.chroma_weight)
    return _encode(PictureSequence(kind), picture_format, planes, step, header)


def encode_mode(modes: ModeCodec, planes: Single, step: int) -> EncodedPicture:
    """Encode a mode as the next picture of `modes`, and advance `modes` by it.

    planes: (size, size, 3), see `to_planes`.  step: see `encode_picture`.
    """
    return _encode(modes.sequence, modes.format, planes, step)


def retained_energy(modes: ModeCodec, planes: Single, step: int) -> float:
    """An estimate from above of the share of a mode's energy that `encode_mode` would retain."""
    total = retained = 0.0
    for lowpass, details in _coefficients(modes.format, planes, step):
        for band in (lowpass, *(band for level in details for band in level)):
            squares = band**2
            total += float(squares.sum())
            retained += float(squares[squares > TILE_THRESHOLD**2].sum())
    return retained / max(total, 1e-9)


def _encode(
    series: PictureSequence,
    picture_format: PictureFormat,
    planes: Single,
    step: int,
    header: bytes = b"",
) -> EncodedPicture:
    pyramids, symbols = quantise_picture(series, _coefficients(picture_format, planes, step))
    return EncodedPicture(
        picture_format.picture_from_pyramids(pyramids, step), header + bytes([step]), symbols
    )


def _coefficients(
    picture_format: PictureFormat, planes: Single, step: int
) -> list[tuple[Array, list[list[Array]]]]:
    """The wavelet coefficients of each plane, see `wavelet.transform`, in quantiser steps."""
    size = step_size(step)
    return [transform(plane / size, LEVELS) for plane in picture_format.weighted_planes(planes)]
