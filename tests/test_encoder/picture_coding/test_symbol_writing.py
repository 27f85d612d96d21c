"""Symbols of pictures are written as the bitwise range encoder writes them."""

import numpy as np
import pytest

from assets.array_band_decoder import code_bit_array, code_magnitudes
from encoder.picture_coding.subband_rdoq import QuantisedBand
from encoder.picture_coding.symbol_writing import band_decisions, range_coded
from protocol.entropy.range_coder import PROBABILITY_ONE, RangeEncoder
from protocol.pictures.coefficient_coding import MAX_MAGNITUDE, UNARY_LIMIT
from shared_model.arrays import Integers

OUTPUTS, PASSES, PER_PASS = 6, 3, 40


def coded_bitwise(bits: Integers, zeros: Integers) -> bytes:
    coder = RangeEncoder()
    code_bit_array(coder, bits, zeros)
    return coder.finish()


@pytest.mark.parametrize("likely", [1, 40, PROBABILITY_ONE // 2, PROBABILITY_ONE - 1])
@pytest.mark.parametrize("seed", range(4))
def test_decisions_give_the_bytes_of_the_range_encoder(seed: int, likely: int) -> None:
    rng = np.random.default_rng(seed)
    zeros = rng.integers(1, likely, 3000, endpoint=True)
    bits = (rng.integers(0, PROBABILITY_ONE, 3000) >= zeros).astype(np.int64)
    assert range_coded([(bits[:7], zeros[:7]), (bits[7:], zeros[7:])]) == coded_bitwise(bits, zeros)


def test_a_carry_goes_through_bytes_that_are_full() -> None:
    # The low end comes close to the upper end of the first half, and passes it at last.
    zeros = np.full(60, PROBABILITY_ONE // 2)
    bits = np.array([0, *[1] * 56, 1, 1, 1])
    fine = np.append(zeros, [3, 65000, 7])
    for last in ([0, 0, 0], [1, 1, 1], [1, 0, 1]):
        assert range_coded([(np.append(bits, last), fine)]) == coded_bitwise(
            np.append(bits, last), fine
        )


def test_no_decisions_have_no_bytes() -> None:
    assert range_coded([]) == b""


def test_a_band_has_its_flags_then_magnitudes_and_signs_pass_by_pass() -> None:
    rng = np.random.default_rng(1)
    large = [UNARY_LIMIT - 1, UNARY_LIMIT, UNARY_LIMIT + 1, UNARY_LIMIT + 900, MAX_MAGNITUDE]
    magnitudes = np.append(large, rng.integers(0, 3, PASSES * PER_PASS - len(large)))
    ends = PER_PASS * np.arange(1, PASSES + 1)
    nonzero = [int((magnitudes[:end] > 0).sum()) for end in ends]
    flags, signs = rng.integers(0, 2, 9), rng.integers(0, 2, nonzero[-1])
    p0 = [
        rng.integers(1, PROBABILITY_ONE, shape)
        for shape in (len(flags), (len(magnitudes), OUTPUTS), len(signs))
    ]
    values = np.zeros((0, 0), np.int64)
    passes = np.column_stack([ends, nonzero])
    band = QuantisedBand(values, flags, p0[0], magnitudes, p0[1], signs, p0[2], passes, 0.0)
    coder, before = RangeEncoder(), (0, 0)
    code_bit_array(coder, flags, p0[0])
    for after in passes.tolist():
        of_pass, of_signs = (slice(*pair) for pair in zip(before, after, strict=True))
        code_magnitudes(coder, magnitudes[of_pass], p0[1][of_pass])
        code_bit_array(coder, signs[of_signs], p0[2][of_signs])
        before = after
    assert range_coded([band_decisions(band)]) == coder.finish()
