"""The delay of a call from what a page has noted: the truth of made-up notes is found."""

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from benchmarks.call_delay.__main__ import figures
from benchmarks.call_delay.clip import SECONDS, is_open, openings


def stages(
    index: NDArray[np.integer], taken_ms: NDArray[np.floating], shown_ms: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
    """When pictures were drawn, how long they had waited, and when they came to the page.

    Packets of eight come 60 ms after their newest picture; each is drawn at once, within 20 ms.
    """
    made_ms = taken_ms + 40.0 * (7 - index % 8) + 60 + 20
    return made_ms, np.full(len(index), 20.0), made_ms + 5


def test_the_delay_of_picture_and_sound_is_found() -> None:
    begun_ms, delay_s, late_s = 1.7e12, 0.43, 0.06
    index = np.arange(32, 904)
    shown_s = index / 25 + delay_s
    shown_ms = begun_ms + 1000 * shown_s
    mouth, taken_ms = 5000 - 900 * is_open(index / 25), begun_ms + 40 * index
    seen = np.stack([shown_ms, mouth, taken_ms, *stages(index, taken_ms, shown_ms)], axis=1)
    played_s = np.arange(1.0, 36.0, 0.02)
    loud = is_open(played_s - delay_s - late_s)
    heard = np.stack([begun_ms + 1000 * played_s, loud], axis=1)
    found = figures(seen, heard, begun_ms)
    assert found["pictures_per_s"] == 25.0
    assert found["delay_ms"] == [430, 430]
    assert found["sound_late_ms"] == pytest.approx(60, abs=10)
    # Of a clip that had begun long before the first frame that was encoded.
    later = seen.copy(), heard.copy()
    for notes in later:
        notes[:, 0] += 7000
    assert figures(*later, begun_ms)["sound_late_ms"] == pytest.approx(60, abs=10)


def test_the_first_and_the_last_minute_have_figures_of_their_own() -> None:
    begun_ms, index = 1.7e12, np.arange(25 * 125)
    taken_ms = begun_ms + 40 * index
    shown_ms, mouth = taken_ms + 430, -is_open(index / 25)
    seen = np.stack([shown_ms, mouth, taken_ms, *stages(index, taken_ms, shown_ms)], axis=1)
    played_s = np.arange(1.0, 125.0, 0.02)
    late_s = np.where(played_s > 62, 0.09, 0.03)
    loud = is_open(played_s - 0.43 - late_s)
    heard = np.stack([begun_ms + 1000 * played_s, loud], axis=1)
    found = figures(seen, heard, begun_ms)
    assert found["minutes_late_ms"] == [pytest.approx(30, abs=10), pytest.approx(90, abs=10)]


def test_of_another_clip_only_what_its_frames_tell_is_found() -> None:
    taken_ms = 1.7e12 + 40.0 * np.arange(48)
    shown_ms = taken_ms + 430
    parts = stages(np.arange(48), taken_ms, shown_ms)
    seen = np.stack([shown_ms, 0 * taken_ms, taken_ms, *parts], axis=1)
    found = figures(seen, np.zeros((0,)), 1.7e12, knows_mouth=False)
    assert found == {
        "pictures_per_s": 25.0,
        "delay_ms": [430, 430],
        "stages_ms": {
            "packet": [140, 280],
            "coded": [60, 60],
            "drawn": [20, 20],
            "page": [5, 5],
            "playout": [205, 345],
        },
        "first_ms": {
            "packet": [280, 280],
            "coded": [60, 60],
            "drawn": [20, 20],
            "page": [5, 5],
            "playout": [65, 65],
        },
    }


def test_sound_that_is_not_found_again_has_no_figure() -> None:
    begun_ms, index = 1.7e12, np.arange(500)
    taken_ms = begun_ms + 40.0 * index
    mouth = -is_open(index / 25)
    parts = stages(index, taken_ms, taken_ms + 430)
    seen = np.stack([taken_ms + 430, mouth, taken_ms, *parts], axis=1)
    noise = np.random.default_rng(1).random(1000)
    heard = np.stack([begun_ms + 20.0 * np.arange(1000), noise], axis=1)
    assert figures(seen, heard, begun_ms)["sound_late_ms"] is None


def test_no_stretch_of_the_clip_is_like_another() -> None:
    time_s = np.arange(0, SECONDS, 0.01)
    level = is_open(time_s)
    for lag_s in np.arange(0.5, 3.0, 0.05):
        assert np.corrcoef(level, is_open(time_s - lag_s))[0, 1] < 0.6
    assert len(openings()) > 10
