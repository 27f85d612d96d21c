"""Faces to pages that draw them; tests/test_player/face_message.test.js reads the same bytes."""

from contextlib import ExitStack

import numpy as np
import pytest

pytest.importorskip("aiohttp")

from risorius.call_page.audience import Audience
from risorius.call_page.face_message import (
    FaceMessage,
    ModelMessage,
    face_values,
    serialise_face,
    serialise_model_message,
)
from risorius.call_page.messages import PictureMessage, Stream
from shared_model.parameters import EAUS, FaceParameters, Pose

BYTES = (
    "41020300fa0000000000000000002440000000000000f03f070000000000403f0200010000000000"
    "0000803f0000000000000000000020410000a0c1000016440000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000803e0000"
    "003f000080bf00000040"
)


def face_message(stream: Stream = Stream.OTHER) -> FaceMessage:
    eau = np.zeros(len(EAUS))
    eau[-1] = 0.25
    face = FaceParameters(
        Pose(np.array([0.0, 1, 0, 0]), np.array([10.0, -20, 600])),
        eau,
        np.array([2.0]),
        np.array([0.5, -1]),
    )
    shown = PictureMessage(stream, 250, 10.0, 1.0, b"", frozen=True, lost=True, waited_ms=3)
    return FaceMessage(shown, 7, 0.75, face_values(face))


def test_a_face_is_written_as_pages_read_it() -> None:
    assert serialise_face(face_message()).hex() == BYTES


def test_a_model_follows_its_number() -> None:
    assert serialise_model_message(ModelMessage(Stream.SELF, 9, b"x")).hex() == "820000000900000078"


def test_who_draws_gets_faces_and_models_and_needs_no_pictures() -> None:
    needs = list[bool]()
    audience = Audience(needs.append)
    model, picture = ModelMessage(Stream.OTHER, 1, b"model"), face_message().shown
    audience.show_model(model)
    audience.show_face(face_message())
    with ExitStack() as stack:
        drawing, looking = (stack.enter_context(audience.watching()) for _ in range(2))
        audience.let_draw(drawing)
        audience.show(picture)
        audience.show_face(face_message(Stream.SELF))
        taken = [[message for _, message in each._waiting] for each in (drawing, looking)]
        assert taken == [[model, face_message(), face_message(Stream.SELF)], [picture]]
        assert needs == [True]
        audience.let_draw(looking)
        assert needs == [True, False]
