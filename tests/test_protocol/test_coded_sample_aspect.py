"""Sample aspect ratios: sizes there and back, and what a model packet may state."""

from dataclasses import replace
from fractions import Fraction

import msgpack  # type: ignore[import-untyped]
import pytest
from packets import CALL, GOLDEN, MODEL

from protocol.errors import ProtocolError
from protocol.model_packet import ASPECT_FORMAT
from protocol.packets import parse_packet, serialise
from protocol.sample_aspect import source_size, square_size, usable_aspect

ASPECTS = [Fraction(a, b) for a, b in ((1, 1), (12, 11), (16, 11), (4, 3), (2, 1), (1, 2), (3, 8))]


@pytest.mark.parametrize("aspect", ASPECTS)
def test_the_size_of_the_source_comes_back(aspect: Fraction) -> None:
    for side in range(32, 2000, 7):
        for size in ((side, 480), (480, side)):
            assert source_size(*square_size(*size, aspect), aspect) == size


def test_pixels_that_are_nearly_square_are_left_alone() -> None:
    assert square_size(176, 144, Fraction(128, 117)) == (176, 144)
    assert square_size(720, 576, Fraction(16, 11)) == (1047, 576)
    assert square_size(320, 360, Fraction(2)) == (640, 360)
    assert square_size(640, 100, Fraction(1, 2)) == (640, 200)


@pytest.mark.parametrize(
    ("stated", "used"),
    [
        (None, 1),
        (Fraction(0), 1),
        (Fraction(-1), 1),
        (Fraction(100), 1),
        (Fraction(1, 100), 1),
        (Fraction(1000001, 1000000), 1),
        (Fraction(128, 117), Fraction(128, 117)),
        (Fraction(4000, 2999), Fraction(4, 3)),
        (Fraction(2999, 4000), Fraction(3, 4)),
    ],
)
def test_what_no_call_can_carry_counts_as_square(
    stated: Fraction | None, used: Fraction | int
) -> None:
    assert float(usable_aspect(stated, 320, 240)) == pytest.approx(float(used), rel=1e-4)


def test_a_picture_that_would_be_too_large_is_not_stretched() -> None:
    assert usable_aspect(Fraction(2), 4096, 100) == 2
    assert usable_aspect(Fraction(2), 4097, 100) == 1


@pytest.mark.parametrize("profile", ["thesis", "default"])
def test_a_model_with_an_aspect_ratio_has_a_format_of_its_own(profile: str) -> None:
    call = replace(CALL, profile=profile, width=640, height=360, sample_aspect=Fraction(2))
    model = replace(MODEL, call=call)
    data = serialise(model)
    assert data[1] == ASPECT_FORMAT and parse_packet(data) == model
    assert model.call.source_size == (320, 360)


@pytest.mark.parametrize("value", [(1, 1), (4, 2), (256, 1), (0, 1), (9, 1), (1,), 2, (True, 2)])
def test_an_aspect_ratio_that_is_not_in_its_one_form_is_refused(value: object) -> None:
    data = serialise(GOLDEN["model_aspect"])
    fields = msgpack.unpackb(data[2:], use_list=False) | {"z": value}
    with pytest.raises(ProtocolError):
        parse_packet(data[:2] + msgpack.packb(fields, use_single_float=True))


def test_a_call_refuses_what_it_cannot_carry() -> None:
    with pytest.raises(ValueError, match="sample aspect ratio"):
        replace(CALL, sample_aspect=Fraction(9))
