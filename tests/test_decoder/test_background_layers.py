"""The background in two layers: the person, and the scene behind."""

import numpy as np
import pytest

from decoder.scene.background_layers import load_background
from encoder.coding.background import BackgroundImage
from protocol.errors import ProtocolError
from protocol.pictures.foreground_mask import MASK_SIDE, serialise_background

SIZE = 128, 96


def room() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A wall that grows brighter to the right, a dark person before its middle."""
    picture = np.repeat(np.linspace(60, 200, 128)[None, :, None], 96, 0).repeat(3, 2)
    picture[30:, 48:80] = 10
    return np.asarray(np.rint(picture), np.uint8)


def person_mask() -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    mask = np.zeros((MASK_SIDE, MASK_SIDE), bool)
    mask[30:, 36:60] = True
    return mask


def test_a_person_is_opaque_and_the_room_is_not() -> None:
    still = load_background(BackgroundImage(room(), person_mask()).encode(4000), *SIZE)
    opacity = still.moving[..., 3]
    assert (opacity[34:, 52:76] == 255).all()
    assert (opacity[:20] == 0).all() and (opacity[:, :40] == 0).all()


def test_the_room_is_continued_behind_the_person() -> None:
    still = load_background(BackgroundImage(room(), person_mask()).encode(4000), *SIZE)
    assert still.static is not None
    wall = np.linspace(60, 200, 128)[None, :, None]
    # The coder's own errors are within a few levels.
    assert np.abs(still.static[:20].astype(float) - wall).max() < 12
    assert np.abs(still.static.astype(float) - wall).max() < 50
    assert still.static.min() > 40


def test_without_a_mask_there_is_no_static_layer() -> None:
    still = load_background(BackgroundImage(room()).encode(2000), *SIZE)
    assert still.moving.shape == (96, 128, 3) and still.static is None
    assert load_background(b"", *SIZE).static is None


def test_a_mask_without_a_picture_is_refused() -> None:
    with pytest.raises(ProtocolError, match="background"):
        load_background(serialise_background(person_mask(), b""), *SIZE)
