"""Raw video: the header that players ask for, and the pictures of a video file."""

import io
from fractions import Fraction

import cv2
import numpy as np
import pytest

from decoder.sinks.y4m_stream import Y4mStream, ycbcr_from_bgr


def written(picture: np.ndarray, matrix: str = "bt601") -> bytes:
    height, width = picture.shape[:2]
    stream = io.BytesIO()
    with Y4mStream(stream, width, height, Fraction(30000, 1001), matrix) as sink:
        sink.write(picture)
    return stream.getvalue()


def test_the_header_says_size_rate_and_sampling() -> None:
    header, frame = written(np.zeros((2, 4, 3), np.uint8)).split(b"\n", 1)
    assert header == b"YUV4MPEG2 W4 H2 F30000:1001 Ip A1:1 C444"
    assert frame == b"FRAME\n" + 8 * b"\x10" + 16 * b"\x80"


@pytest.mark.parametrize(("matrix", "luma"), [("bt601", (41, 145, 81)), ("bt709", (32, 173, 63))])
def test_the_primaries_have_the_luma_of_the_matrix(matrix: str, luma: tuple[int, ...]) -> None:
    primaries = (255 * np.eye(3, dtype=np.uint8))[None]
    data = written(primaries, matrix).split(b"FRAME\n")[1]
    assert tuple(data[:3]) == luma


def test_a_picture_comes_back_from_its_planes() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    data = written(picture, "bt709").split(b"FRAME\n")[1]
    planes = np.frombuffer(data, np.uint8).reshape(3, 6, 8).transpose(1, 2, 0).astype(float)
    rows = ycbcr_from_bgr("bt709").astype(float)
    back = (planes - rows[:, 3]) @ np.linalg.inv(rows[:, :3]).T
    assert np.abs(back - picture).max() < 2.5


def test_grey_is_what_opencv_makes_of_it() -> None:
    picture = np.random.default_rng(2).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    data = written(picture).split(b"FRAME\n")[1]
    luma = np.frombuffer(data, np.uint8)[:48].reshape(6, 8).astype(float)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    assert np.abs((luma - 16) * 255 / 219 - grey).max() < 1.6


def test_another_size_or_matrix_is_refused() -> None:
    with pytest.raises(ValueError, match="shape"):
        Y4mStream(io.BytesIO(), 4, 4, Fraction(25), "bt601").write(np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(ValueError, match="bt2020"):
        Y4mStream(io.BytesIO(), 4, 4, Fraction(25), "bt2020")
