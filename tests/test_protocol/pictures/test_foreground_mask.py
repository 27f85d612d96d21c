"""The foreground mask: decoding inverts coding; segmentation finds the person and nobody else."""

from pathlib import Path

import numpy as np
import pytest
from conftest import ClipFrames

from encoder.coding.background import BackgroundImage
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmark_indices import face_outline
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.segmentation import segment_person
from encoder.detection.tflite import find_segmentation_network
from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError
from protocol.pictures.foreground_mask import (
    MASK_SIDE,
    MAX_MASK_BYTES,
    TAG,
    parse_background,
    serialise_background,
)
from shared_model.arrays import Mask

PICTURE = b"S and so on"


def person() -> Mask:
    """A head upon shoulders."""
    y, x = np.mgrid[:MASK_SIDE, :MASK_SIDE] / MASK_SIDE - 0.5
    return np.asarray(
        (x**2 / 0.03 + (y + 0.1) ** 2 / 0.06 < 1) | (x**2 / 0.12 + (y - 0.6) ** 2 < 1)
    )


@pytest.mark.parametrize(
    "mask",
    [
        person(),
        np.zeros((MASK_SIDE, MASK_SIDE), bool),
        np.random.default_rng(1).random((MASK_SIDE, MASK_SIDE)) < 0.5,
    ],
    ids=["person", "nobody", "noise"],
)
def test_a_mask_arrives_with_its_picture(mask: Mask) -> None:
    found, picture = parse_background(serialise_background(mask, PICTURE))
    assert found is not None and np.array_equal(found, mask)
    assert picture == PICTURE


def test_a_picture_alone_is_sent_as_it_is() -> None:
    assert serialise_background(None, PICTURE) == PICTURE
    assert parse_background(PICTURE) == (None, PICTURE)
    assert parse_background(b"") == (None, b"")


def test_a_persons_mask_takes_a_few_dozen_bytes() -> None:
    assert len(serialise_background(person(), b"")) < 70


@pytest.mark.parametrize(
    "data",
    [
        TAG,
        TAG + b"\x80",
        TAG + encode_varint(3) + b"ab",
        TAG + encode_varint(MAX_MASK_BYTES + 1) + bytes(MAX_MASK_BYTES + 1),
        TAG + encode_varint(200) + bytes(200),
    ],
    ids=["no length", "half a length", "too short", "too long", "bytes too many"],
)
def test_a_damaged_mask_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError, match="mask"):
        parse_background(data)


@pytest.mark.no_cover
def test_flipped_bits_give_a_mask_or_are_refused() -> None:
    data = serialise_background(person(), PICTURE)
    # Each bit of a byte in turn.
    for place in range(0, 8 * (len(data) - len(PICTURE)), 3):
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        try:
            found, _ = parse_background(bytes(flipped))
        except ProtocolError:
            continue
        assert found is None or found.shape == (MASK_SIDE, MASK_SIDE)


def test_a_picture_with_its_mask_keeps_within_its_bytes() -> None:
    noise = np.random.default_rng(3).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    data = BackgroundImage(noise, person()).encode(900)
    assert 700 < len(data) <= 900
    found, picture = parse_background(data)
    assert found is not None and np.array_equal(found, person())
    assert picture[:1] == b"S"


@pytest.fixture
def segmentation() -> Path:
    path = find_segmentation_network()
    if path is None:
        pytest.skip("the package mediapipe, which has the network, is not installed")
    return path


def test_segmentation_separates_the_person_from_the_background(
    segmentation: Path, networks: Path, clip_frames: ClipFrames
) -> None:
    (frame,) = clip_frames("akiyo.mp4", 1)
    found = LandmarkTracker(networks, BlazeFaceDetector(networks)).update(frame)
    assert found is not None
    lit = segment_person(segmentation, frame, face_outline(found.points))
    dark = segment_person(segmentation, frame // 12, face_outline(found.points))
    assert lit is not None and dark is not None
    assert (lit ^ dark).mean() < 0.03
    mask = lit

    def shown(column_px: int, row_px: int) -> bool:
        return bool(mask[row_px * MASK_SIDE // 288, column_px * MASK_SIDE // 352])

    # Read off the picture by hand: hair, chin, both shoulders; the screens, what is above the head.
    assert all(shown(*at) for at in ((180, 60), (175, 155), (90, 240), (270, 240)))
    assert not any(shown(*at) for at in ((60, 50), (260, 90), (175, 20), (20, 200), (340, 150)))


def test_a_face_without_a_person_has_no_mask(segmentation: Path, clip_frames: ClipFrames) -> None:
    (frame,) = clip_frames("akiyo.mp4", 1)
    on_the_wall = np.array([[10.0, 10.0], [60.0, 10.0], [60.0, 70.0], [10.0, 70.0]])
    assert segment_person(segmentation, frame, on_the_wall) is None
