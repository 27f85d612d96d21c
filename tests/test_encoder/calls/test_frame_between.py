"""A call in real time looks for landmarks in every second frame; the others are fitted as well."""

from collections.abc import Sequence
from itertools import pairwise
from math import inf
from pathlib import Path

import numpy as np
import pytest
from call_contents import played
from conftest import LIVE_MODEL_BYTES, without_layers
from live_encoders import live_encoder

from decoder.playout.playout import PlayoutFrame
from encoder.calls.session_stats import SessionStats
from encoder.calls.waiting_frames import FrameBetween, may_lack_landmarks
from encoder.capture.video_source import open_source
from encoder.detection.landmarks import LandmarkTracker
from protocol.call_file import CallWriter
from protocol.packets import ControlKind
from shared_model.arrays import Array, Picture
from shared_model.parameters import EAU_INDEX

# Of the talking face; the first packet has one frame, the others eight.
FRAMES = 41
# Which of two calls of so many frames is moved.
SHIFT_PX, MOVED, FEWER = 3, (12, 13), 17
PICTURE = np.zeros((4, 4, 3), np.uint8)


def test_neither_two_frames_in_a_row_nor_the_last_of_a_packet_lack_landmarks() -> None:
    omitted = [may_lack_landmarks(to_last) for to_last in reversed(range(8))]
    assert not omitted[-1] and not any(a and b for a, b in pairwise(omitted))
    assert any(omitted)


def test_a_frame_waits_for_the_one_after_it() -> None:
    between, points = FrameBetween(), np.zeros((468, 3))
    assert between.take(0, points) is None
    between.wait(1, PICTURE)
    found = between.take(4, points + 3)
    assert found is not None and found.index == 1 and found.picture is PICTURE
    assert found.share == 0.25 and (found.points == 0.75).all()
    assert between.take(5, points) is None and between.take_last() is None
    between.wait(6, PICTURE)
    last = between.take_last()
    assert last is not None and last.index == 6 and last.share == 0 and last.points is points


def test_a_frame_whose_neighbours_have_no_landmarks_is_left() -> None:
    between, points = FrameBetween(), np.zeros((468, 3))
    between.wait(1, PICTURE)
    assert between.take(2, points) is None
    between.wait(3, PICTURE)
    # The face was lost in frame 4, and others were seen since.
    assert between.take(9, points) is not None
    between.wait(7, PICTURE)
    assert between.take(10, points) is None


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[Picture]:
    """The pictures in which landmarks are looked for."""
    pictures, update = list[Picture](), LandmarkTracker.update

    def noted(self: LandmarkTracker, frame: Picture, following: Picture | None = None) -> object:
        pictures.append(frame)
        return update(self, frame, following)

    monkeypatch.setattr(LandmarkTracker, "update", noted)
    return pictures


def frames_of(
    clip: Path, call: Path, moved: int | None = None, count: int = FRAMES
) -> list[PlayoutFrame]:
    """A call in real time of the clip's first frames; `moved` is shifted by `SHIFT_PX`."""
    with open_source(str(clip)) as capture, CallWriter(call) as sink, without_layers():
        session = live_encoder(capture, sink, SessionStats(), LIVE_MODEL_BYTES, realtime=True)
        for index, picture in capture:
            if index < count:
                shown = np.roll(picture, SHIFT_PX, axis=1) if index == moved else picture
                session.frame(index, shown)
        session.end(count)
    frames = played(call)
    assert [frame.index for frame in frames] == list(range(count))
    return frames


def jaws(frames: Sequence[PlayoutFrame]) -> Array:
    return np.array([frame.face.eau[EAU_INDEX["jaw_drop"]] for frame in frames])


def across_mm(frames: Sequence[PlayoutFrame]) -> Array:
    return np.array([frame.face.pose.translation_mm[0] for frame in frames])


def test_every_second_frame_is_fitted_without_landmarks(
    talking_clip: Path,
    networks: Path,
    searched: list[Picture],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    alternating = frames_of(talking_clip, tmp_path / "a.rzo")
    assert len(searched) == 1 + FRAMES // 2
    still = across_mm(alternating)[:FEWER]
    # Landmarks are looked for in the first, not in the second: half-way between its neighbours the
    # face would stand still.
    (seen, between) = (
        (across_mm(frames_of(talking_clip, tmp_path / "moved.rzo", frame, FEWER)) - still)[frame]
        for frame in MOVED
    )
    assert seen > 3 and between > seen / 3
    searched.clear()
    monkeypatch.setattr("encoder.live_model.pacing.MIN_ALTERNATING_FPS", inf)
    every = frames_of(talking_clip, tmp_path / "b.rzo")
    assert len(searched) == FRAMES
    assert np.corrcoef(jaws(alternating), jaws(every))[0, 1] > 0.97


def test_a_face_that_is_gone_is_said_to_be(
    talking_clip: Path, networks: Path, tmp_path: Path
) -> None:
    call, gone = tmp_path / "gone.rzo", range(12, 30)
    stats = SessionStats()
    with open_source(str(talking_clip)) as capture, CallWriter(call) as sink, without_layers():
        session = live_encoder(capture, sink, stats, LIVE_MODEL_BYTES, realtime=True)
        for index, picture in capture:
            if index < FRAMES:
                session.frame(index, np.full_like(picture, 90) if index in gone else picture)
        session.end(FRAMES)
    kinds = [kind for kind, _ in stats.events if kind is not ControlKind.PERSON_GONE]
    assert kinds == [ControlKind.FACE_LOST, ControlKind.FACE_FOUND]
    assert len(played(call)) == FRAMES
