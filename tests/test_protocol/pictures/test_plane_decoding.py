"""The NumPy decoder of subbands reads what the compiled one reads, from whatever bytes."""

import random
from typing import Any

import numpy as np
import pytest
from pyramids import same

from assets.array_band_decoder import ArrayBandDecoder
from encoder.picture_coding.picture_rdoq import quantise_picture
from protocol.errors import ProtocolError
from protocol.pictures.picture_codec import plane_shapes
from protocol.pictures.plane_decoding import decode_planes
from protocol.pictures.probability_model import BACKGROUND, MODE, TEXTURE
from protocol.pictures.subband_coding import PictureSequence
from protocol.pictures.subband_pyramid import SubbandPyramid
from protocol.pictures.wavelet import LEVELS, transform

SHAPES = plane_shapes(33, 47)


@pytest.mark.parametrize("kind", [BACKGROUND, MODE])
def test_arrays_read_from_any_bytes_what_compiled_loops_read(kind: int) -> None:
    rng = random.Random(4)
    for length in (0, 3, 40, 300):
        data = rng.randbytes(length)
        results: list[list[SubbandPyramid] | str] = []
        for options in ((), (ArrayBandDecoder,)):
            try:
                results.append(decode_planes(PictureSequence(kind), "it", data, SHAPES, *options))
            except ProtocolError as error:
                results.append(str(error))
        first, second = results
        if isinstance(first, str) or isinstance(second, str):
            assert first == second
        else:
            assert same(first, second)


def test_arrays_read_what_the_encoder_chose() -> None:
    sender, receiver = PictureSequence(TEXTURE), PictureSequence(TEXTURE)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        planes = [np.cumsum(rng.normal(size=each) * 9, 1) for each in SHAPES]
        chosen, symbols = quantise_picture(sender, [transform(each, LEVELS) for each in planes])
        data = symbols.serialise()
        assert same(decode_planes(receiver, "it", data, SHAPES, ArrayBandDecoder), chosen)


@pytest.mark.parametrize("options", [(), (ArrayBandDecoder,)], ids=["compiled", "arrays"])
def test_a_magnitude_that_no_encoder_writes_is_refused(options: tuple[Any, ...]) -> None:
    with pytest.raises(ProtocolError, match="too large"):
        decode_planes(PictureSequence(MODE), "it", b"\xff" * 999, [(16, 16)], *options)
