"""The picture of another face: of an image, of the person of a call file, or drawn."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from decoder.scene.reenactment import read_model
from risorius.cli import main
from risorius.face_picture import GENERIC, face_picture
from shared_model.errors import UserError


def test_a_call_file_gives_the_picture_of_its_person(call: Path) -> None:
    picture, sender = face_picture(str(call)), read_model(call).call
    assert picture.shape == (sender.height, sender.width, 3)
    assert picture.std() > 20


def test_an_image_is_taken_as_it_is(tmp_path: Path) -> None:
    picture = np.random.default_rng(1).integers(0, 255, (20, 30, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "face.png"), picture)
    np.testing.assert_array_equal(face_picture(str(tmp_path / "face.png")), picture)


def test_the_generic_head_is_drawn() -> None:
    picture = face_picture(GENERIC)
    middle = picture[200:280, 280:360].mean((0, 1))
    assert picture.shape == (480, 640, 3) and middle[2] > middle[0] + 20


def test_what_is_no_picture_is_said(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no picture")
    with pytest.raises(UserError, match="neither an image nor a call file"):
        face_picture(str(tmp_path / "text.png"))
    with pytest.raises(UserError, match="no such file"):
        face_picture(str(tmp_path / "nothing.png"))
    assert main(["call", "--listen", "127.0.0.1:0", "--face-on"]) == 2
