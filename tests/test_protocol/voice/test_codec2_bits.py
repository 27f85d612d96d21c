"""Prefix codes of Codec2 1200: the codes of the page, complete, and shorter for speech."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sounds import voiced_sound

from protocol.voice.bit_string import BitReader, BitWriter
from protocol.voice.codec2_bits import (
    CODEC2_BITS,
    PITCH_ENERGY_LENGTHS,
    SPECTRUM_LENGTHS,
    VOICING_LENGTHS,
    Fields1200,
    PrefixCode,
    fields_1200,
    frame_1200,
)
from protocol.voice.voice_block import serialise_frames

PAGE = Path(__file__).parents[3] / "docs" / "format.md"


def test_lengths_are_those_of_the_page() -> None:
    lines = r"^ {4}(?:voicing|pitch and energy|spectrum|) +([0-9a-f]{16,64})$"
    digits = "".join(re.findall(lines, PAGE.read_text(), re.MULTILINE))
    in_use = VOICING_LENGTHS + PITCH_ENERGY_LENGTHS + SPECTRUM_LENGTHS
    assert digits == "".join(f"{length:x}" for length in in_use)


def test_codes_are_canonical() -> None:
    code, symbols, writer = PrefixCode((2, 1, 3, 3)), (1, 0, 2, 3), BitWriter()
    for symbol in symbols:
        code.put(symbol, writer)
    assert writer.to_bytes() == int("0" + "10" + "110" + "111" + 7 * "0", 2).to_bytes(2)


@pytest.mark.parametrize("lengths", [(1,), (2, 2, 2), (1, 1, 1)])
def test_lengths_that_leave_bits_without_a_meaning_are_refused(lengths: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="no complete prefix code"):
        PrefixCode(lengths)


@given(st.lists(st.integers(0, 255), max_size=40))
def test_symbols_come_back(symbols: list[int]) -> None:
    code, writer = PrefixCode(PITCH_ENERGY_LENGTHS), BitWriter()
    for symbol in symbols:
        code.put(symbol, writer)
    reader = BitReader(writer.to_bytes(), 0)
    assert [code.take(reader) for _ in symbols] == symbols


def test_fields_are_where_the_page_has_them() -> None:
    numbered = int("10" + "00000011" + "01" + "00000101" + "1" + 25 * "0" + "1" + "0", 2)
    fields = Fields1200(0b1001, (3, 5), 1 << 8, 1)
    assert fields_1200(numbered.to_bytes(6)) == fields
    assert frame_1200(fields) == numbered.to_bytes(6)


def test_codec2_leaves_its_spare_bit_and_speech_takes_less_than_it_makes() -> None:
    pycodec2 = pytest.importorskip("pycodec2")
    codec, sound = pycodec2.Codec2(1200), voiced_sound(8000)
    frames = [bytes(codec.encode(sound[i : i + 320])) for i in range(0, len(sound), 320)]
    assert 8 * len(serialise_frames("1200", frames)) < 0.97 * CODEC2_BITS["1200"] * len(frames)
