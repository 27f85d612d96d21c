"""PSNR as eq. 6.1 says, over the right pixels."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from decoder.sinks.frame_sink import open_sink
from encoder.detection.landmark_indices import FACE_OVAL
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.video_quality import face_mask_finder, face_oval_mask, measure_quality
from shared_model.arrays import Array, Mask, Picture
from shared_model.errors import UserError

WIDTH, HEIGHT = 64, 48


def left_half(picture: Picture) -> Mask:
    area = np.zeros(picture.shape[:2], np.bool_)
    area[:, : picture.shape[1] // 2] = True
    return area


def no_face(picture: Picture) -> None:
    return None


def ignore(done: int, total: int | None) -> None:
    assert done > 0


def flat(level: int, width: int = WIDTH, height: int = HEIGHT) -> Picture:
    return np.full((height, width, 3), level, np.uint8)


def write(path: Path, pictures: list[Picture]) -> str:
    height, width = pictures[0].shape[:2]
    with open_sink(path, width, height, Fraction(25)) as sink:
        for picture in pictures:
            sink.write(picture)
    return str(path)


def test_psnr_of_a_known_error_is_eq_6_1() -> None:
    error = squared_error(flat(100), flat(105))
    assert psnr_db(error) == pytest.approx(10 * np.log10(255**2 / 25))


def test_psnr_of_equal_pictures_is_finite() -> None:
    assert np.isfinite(psnr_db(squared_error(flat(7), flat(7))))


def test_only_the_face_area_counts_for_the_face(tmp_path: Path) -> None:
    copy = flat(100)
    copy[:, : WIDTH // 2] = 110
    source = write(tmp_path / "a.mkv", [flat(100)] * 3)
    quality = measure_quality(source, write(tmp_path / "b.mkv", [copy] * 3), left_half, ignore)
    assert quality.frames == quality.face_frames == 3
    assert quality.face_psnr_db == pytest.approx(28.13, abs=0.01)
    assert quality.full_psnr_db == pytest.approx(31.14, abs=0.01)


def test_the_fifth_percentile_shows_a_bad_frame(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mkv", [flat(100)] * 10)
    decoded = write(tmp_path / "b.mkv", [flat(105)] * 9 + [flat(150)])
    quality = measure_quality(source, decoded, left_half, ignore)
    assert quality.face_psnr_db is not None and quality.face_psnr_p5_db is not None
    assert quality.face_psnr_p5_db < quality.face_psnr_db - 5


def test_without_a_face_only_the_picture_is_measured(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mkv", [flat(100)] * 2)
    quality = measure_quality(source, write(tmp_path / "b.mkv", [flat(101)] * 2), no_face, ignore)
    assert quality.face_frames == 0
    assert quality.face_psnr_db is None and quality.face_psnr_p5_db is None
    assert quality.full_psnr_db == pytest.approx(48.13, abs=0.01)


def test_odd_pictures_are_compared_to_their_edges(tmp_path: Path) -> None:
    source = write(tmp_path / "%d.png", [flat(100, 63, 47)] * 2)
    decoded = write(tmp_path / "b.mkv", [flat(105, 63, 47)] * 2)
    quality = measure_quality(source, decoded, left_half, ignore)
    assert quality.full_psnr_db == pytest.approx(34.15, abs=0.01)


def test_only_the_encoded_part_of_a_source_is_compared(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mkv", [flat(100)] * 5)
    decoded = write(tmp_path / "b.mkv", [flat(105)] * 2)
    assert measure_quality(source, decoded, no_face, ignore, max_frames=2).frames == 2


def test_another_number_of_frames_is_refused(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mkv", [flat(100)] * 5)
    decoded = write(tmp_path / "b.mkv", [flat(105)] * 4)
    with pytest.raises(UserError, match="different numbers of frames"):
        measure_quality(source, decoded, no_face, ignore)


def test_another_size_is_refused(tmp_path: Path) -> None:
    source = write(tmp_path / "a.mkv", [flat(100)])
    decoded = write(tmp_path / "b.mkv", [flat(100, 32, 32)])
    with pytest.raises(UserError, match="32x32"):
        measure_quality(source, decoded, no_face, ignore)


def test_the_oval_is_the_hull_of_its_points() -> None:
    angles = np.linspace(0, 2 * np.pi, len(FACE_OVAL), endpoint=False)
    points: Array = np.zeros((468, 3))
    points[list(FACE_OVAL), 0] = 32 + 20 * np.cos(angles)
    points[list(FACE_OVAL), 1] = 24 + 15 * np.sin(angles)
    area = face_oval_mask(points, HEIGHT, WIDTH)
    assert area[24, 32] and not area[2, 2]
    assert area.sum() == pytest.approx(np.pi * 20 * 15, rel=0.07)


def test_a_real_face_is_found_and_noise_has_none(carphone: Path, noise: Path) -> None:
    finder = face_mask_finder(pytest.fail)
    face = measure_quality(str(carphone), str(carphone), finder, ignore)
    assert face.face_frames >= 118
    assert (
        measure_quality(str(noise), str(noise), face_mask_finder(pytest.fail), ignore).face_frames
        == 0
    )
