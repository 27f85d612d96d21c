"""Which of several faces is followed, in pictures with a poster and a person."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ClipFrames

from encoder.calls.face_search import SWITCHED, open_landmark_search
from encoder.calls.session_stats import SessionStats
from encoder.detection.landmarks import open_landmark_tracker
from shared_model.arrays import Picture

WIDTH, HEIGHT, POSTER_PX = 640, 360, 60


def with_noise(picture: Picture, seed: int) -> Picture:
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def poster(networks: Path, clip_frames: ClipFrames) -> Picture:
    """A face of sixty pixels."""
    [picture] = clip_frames("still.mpg", 1)
    found = open_landmark_tracker(False).update(picture)
    assert found is not None
    (left, top), (right, bottom) = found.points[:, :2].min(0), found.points[:, :2].max(0)
    margin = 0.4 * (right - left)
    part = picture[max(0, int(top - margin)) : int(bottom + margin / 2)]
    part = part[:, max(0, int(left - margin)) : int(right + margin)]
    scale = POSTER_PX / (right - left)
    return np.asarray(cv2.resize(part, None, fx=scale, fy=scale), np.uint8)


@pytest.fixture(scope="module")
def person(clip_frames: ClipFrames) -> list[Picture]:
    frames = clip_frames("studio.mp4", 175)[75:]
    return [np.asarray(cv2.resize(frame, (WIDTH, HEIGHT)), np.uint8) for frame in frames]


def on_the_wall(picture: Picture, poster: Picture, number: int) -> Picture:
    shown = picture.copy()
    shown[8 : 8 + len(poster), 8 : 8 + poster.shape[1]] = poster
    return with_noise(shown, number)


def followed(frames: list[Picture]) -> tuple[list[float], SessionStats]:
    """Where the face is that is followed, by frame; nan: nowhere."""
    stats = SessionStats()
    search = open_landmark_search(stats, refine_eyelids=False)
    places = []
    for frame, following in zip(frames, [*frames[1:], None], strict=True):
        found = search.find(frame, following)
        places.append(np.nan if found is None else float(found.points[:, 0].mean()))
    return places, stats


def test_a_poster_gives_way_to_who_walks_in(poster: Picture, person: list[Picture]) -> None:
    wall, walks = np.full((HEIGHT, WIDTH, 3), 90, np.uint8), list[Picture]()
    for number in range(60):
        walks.append(on_the_wall(wall, poster, number))
    for number, frame in enumerate(person):
        away = max(0, WIDTH - 120 - 16 * number)
        shown = wall.copy()
        shown[:, away:] = frame[:, : WIDTH - away]
        walks.append(on_the_wall(shown, poster, 60 + number))
    places, stats = followed(walks)
    assert np.nanmax(places[:60]) < 100
    assert np.nanmin(places[-30:]) > 200
    assert SWITCHED in stats.warnings


def test_who_lives_stays_beside_a_poster(poster: Picture, person: list[Picture]) -> None:
    frames = [on_the_wall(frame, poster, number) for number, frame in enumerate(person)]
    places, stats = followed(frames)
    assert np.nanmin(places) > 200 and SWITCHED not in stats.warnings


def test_of_two_who_live_the_one_who_is_followed_stays(
    clip_frames: ClipFrames, person: list[Picture]
) -> None:
    other = [cv2.resize(frame, (320, 320)) for frame in clip_frames("turn.mp4", len(person))]
    both = []
    for number, frame in enumerate(person):
        shown = np.full((HEIGHT, WIDTH + 320, 3), 90, np.uint8)
        shown[:, :WIDTH] = frame
        if number > 20:
            shown[:320, WIDTH:] = other[number]
        both.append(shown)
    places, stats = followed(both)
    assert np.nanmax(places) < WIDTH and SWITCHED not in stats.warnings
