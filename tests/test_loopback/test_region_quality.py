"""What is around the face: PSNR over the right pixels, SSIMULACRA2, flicker."""

import numpy as np
import pytest

from loopback.quality.region_quality import FRAME_INTERVAL, RegionMeter, RegionQuality, region_meter
from shared_model.arrays import Mask, Picture

SIZE = 64


def flat(level: int) -> Picture:
    return np.full((SIZE, SIZE, 3), level, np.uint8)


def square(first: int, last: int) -> Mask:
    mask = np.zeros((SIZE, SIZE), np.bool_)
    mask[first:last, first:last] = True
    return mask


FACE, PEOPLE = square(24, 40), [square(8, 56)] * 3


def db(difference: float) -> float:
    return float(10 * np.log10(255**2 / difference**2))


def test_each_region_counts_its_own_pixels_alone() -> None:
    copy = flat(102)
    copy[square(8, 56)] = 110
    copy[FACE] = 200
    meter = RegionMeter(PEOPLE, None)
    meter.add(0, flat(100), copy, FACE)
    result = meter.result()
    assert result.person_psnr_db == pytest.approx(db(10), abs=0.01)
    assert result.background_psnr_db == pytest.approx(db(2), abs=0.01)
    assert result.face_ssimulacra2 is None and result.picture_ssimulacra2 is None


def test_a_face_is_no_background_where_the_person_is_not_found() -> None:
    copy = flat(104)
    copy[FACE] = 0
    meter = RegionMeter([np.zeros((SIZE, SIZE), np.bool_)], None)
    meter.add(0, flat(100), copy, FACE)
    assert meter.result().background_psnr_db == pytest.approx(db(4), abs=0.01)
    assert meter.result().person_psnr_db is None


def test_frames_between_are_left_out() -> None:
    meter = RegionMeter(PEOPLE, None)
    for index in range(1, FRAME_INTERVAL):
        meter.add(index, flat(100), flat(0), None)
    assert meter.result() == RegionQuality()


def test_flicker_is_the_change_of_the_copy_over_that_of_the_source() -> None:
    meter = RegionMeter(PEOPLE, None)
    for index, (original, copy) in enumerate([(100, 100), (102, 101), (100, 100)]):
        meter.add(FRAME_INTERVAL * index, flat(original), flat(copy), FACE)
    assert meter.result().flicker_ratio == pytest.approx(0.5)


def test_ssimulacra2_of_the_face_sees_the_face_alone() -> None:
    pytest.importorskip("ssimulacra2")
    meter = RegionMeter(None, region_meter(PEOPLE, lambda line: None).similarity)
    noise = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE, 3), np.uint8)
    copy = flat(128)
    copy[FACE] = noise[FACE]
    meter.add(0, noise, copy, FACE)
    result = meter.result()
    assert result.face_ssimulacra2 is not None and result.face_ssimulacra2 > 99
    assert result.picture_ssimulacra2 is not None and result.picture_ssimulacra2 < 50


def test_frames_of_blinks_are_looked_at_wherever_they_are() -> None:
    blinks = np.zeros(2 * FRAME_INTERVAL, np.bool_)
    blinks[[3, FRAME_INTERVAL]] = True
    meter = RegionMeter(None, lambda _original, copy: float(copy.max()), blinks=blinks)
    for index in range(2 * FRAME_INTERVAL):
        meter.add(index, flat(0), flat(index), FACE)
    result = meter.result()
    assert result.blink_ssimulacra2 == (3 + FRAME_INTERVAL) / 2
    assert result.face_ssimulacra2 == result.picture_ssimulacra2 == FRAME_INTERVAL / 2


def test_what_cannot_be_measured_is_said() -> None:
    lines: list[str] = []
    meter = region_meter(None, lines.append)
    assert "no segmentation network" in lines[0]
    meter.add(0, flat(100), flat(101), FACE)
    assert meter.result().person_psnr_db is None


def test_other_intervals_look_at_other_frames() -> None:
    meter = RegionMeter([square(0, 32), square(0, 64)], None, interval=2)
    for index in range(3):
        meter.add(index, flat(100), flat(100 + 2 * index), None)
    assert meter.result().person_psnr_db == pytest.approx((db(1e-3) + db(4)) / 2, abs=0.01)
