"""The delay of a call from what a page has noted: the truth of made-up notes is found."""

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from scripts.call_delay.__main__ import figures
from scripts.call_delay.clip import SECONDS, is_open, openings


def test_the_delay_of_picture_and_sound_is_found() -> None:
    begun_ms, delay_s, late_s = 1.7e12, 0.43, 0.06
    index = np.arange(30, 900)
    shown_s = index / 25 + delay_s
    shown_ms = begun_ms + 1000 * shown_s
    mouth, taken_ms = 5000 - 900 * is_open(index / 25), begun_ms + 40 * index
    seen = np.stack([shown_ms, mouth, taken_ms, shown_ms - 50], axis=1)
    played_s = np.arange(1.0, 36.0, 0.02)
    loud = is_open(played_s - delay_s - late_s)
    heard = np.stack([begun_ms + 1000 * played_s, loud], axis=1)
    found = figures(seen, heard, begun_ms)
    assert found["pictures_per_s"] == 25.0
    assert found["delay_ms"] == [430, 430] and found["drawn_ms"] == [380, 380]
    assert found["picture_ms"] == pytest.approx(430, abs=10)
    assert found["sound_late_ms"] == pytest.approx(60, abs=10)


def test_of_another_clip_only_what_its_frames_tell_is_found() -> None:
    taken_ms = 1.7e12 + 40.0 * np.arange(50)
    seen = np.stack([taken_ms + 300, 0 * taken_ms, taken_ms, taken_ms + 250], axis=1)
    found = figures(seen, np.zeros((0,)), 1.7e12, knows_mouth=False)
    assert found == {"pictures_per_s": 25.0, "delay_ms": [300, 300], "drawn_ms": [250, 250]}


def test_no_stretch_of_the_clip_is_like_another() -> None:
    time_s = np.arange(0, SECONDS, 0.01)
    level = is_open(time_s)
    for lag_s in np.arange(0.5, 3.0, 0.05):
        assert np.corrcoef(level, is_open(time_s - lag_s))[0, 1] < 0.6
    assert len(openings()) > 10
