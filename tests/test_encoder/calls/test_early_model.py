"""The first model of a call, made before anybody has come."""

from fractions import Fraction
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from call_contents import packets_of
from live_encoders import live_encoder

from encoder.calls.early_model import (
    LOOK_INTERVAL_S,
    REFRESH_INTERVAL_S,
    EarlyModelMaker,
)
from encoder.calls.session_stats import SessionStats
from encoder.capture.live_capture import NO_PICTURE, FrameMailbox, LiveCapture
from encoder.capture.video_source import VideoFormat, open_source
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import budget_for
from encoder.live_model.call_trainer import CallTrainers, FirstModel
from encoder.live_model.pacing import REAL_TIME
from protocol.call_file import CallWriter
from protocol.model_packet import ModelPacket
from shared_model.arrays import Picture


class Waiting:
    """A maker that watches a camera, and a clock that somebody sets."""

    def __init__(self, face: Picture) -> None:
        height, width = face.shape[:2]
        video = VideoFormat(width, height, Fraction(25), "bt601", Fraction(1))
        budget = budget_for("live", 6000)
        trainers = CallTrainers(video, GopStructure(), budget, REAL_TIME)
        self.now_s = 0.0
        self.maker = EarlyModelMaker(trainers, clock=lambda: self.now_s)
        self._mailbox = FrameMailbox(Fraction(25))
        self._mailbox.put(face, 0.0)
        self._capture = LiveCapture("camera", self._mailbox, Fraction(25))

    def show(self, picture: Picture, now_s: float) -> FirstModel | None:
        """The model after the camera has shown a picture."""
        self.now_s = now_s
        self._mailbox.put(picture, now_s)
        busy = iter([True, False])
        self.maker.watch(self._capture, lambda: next(busy))
        return self.maker.model


@pytest.fixture(scope="module")
def faces(talking_clip: Path) -> list[Picture]:
    with open_source(str(talking_clip)) as capture:
        return [picture for _, picture in islice(capture, 2)]


def test_a_camera_is_looked_at_from_time_to_time(faces: list[Picture]) -> None:
    waiting, nobody = Waiting(faces[0]), np.full_like(faces[0], 90)
    assert waiting.show(nobody, 0.0) is None
    assert waiting.show(faces[0], 0.5 * LOOK_INTERVAL_S) is None
    first = waiting.show(faces[0], LOOK_INTERVAL_S)
    assert first is not None and first.version.packet.progressive
    soon = LOOK_INTERVAL_S + 0.5 * REFRESH_INTERVAL_S
    assert waiting.show(faces[1], soon) is first
    again = waiting.show(faces[1], LOOK_INTERVAL_S + REFRESH_INTERVAL_S)
    assert again is not None and again.version.packet.texture != first.version.packet.texture
    later = 2 * LOOK_INTERVAL_S + REFRESH_INTERVAL_S
    assert waiting.show(nobody, later) is None
    # Whoever comes next has a model of their own.
    assert waiting.show(faces[0], later + LOOK_INTERVAL_S) not in (None, first, again)
    assert waiting.show(NO_PICTURE, later + 2 * LOOK_INTERVAL_S) is None


def test_a_call_begins_with_it(faces: list[Picture], talking_clip: Path, tmp_path: Path) -> None:
    early = Waiting(faces[0]).show(faces[1], 0.0)
    assert early is not None
    path = tmp_path / "call.rzo"
    with open_source(str(talking_clip)) as capture, CallWriter(path) as sink:
        encoder = live_encoder(capture, sink, SessionStats(), 6000, realtime=False, early=early)
        encoder.frame(0, faces[0])
        encoder.close()
    first = packets_of(path)[0]
    assert isinstance(first, ModelPacket)
    assert first.texture == early.version.packet.texture and first.call.start_frame == 0


def test_a_file_is_read_up_to_its_first_face(faces: list[Picture], talking_clip: Path) -> None:
    waiting = Waiting(faces[0])
    # Its first frame has one: nobody asks on.
    waiting.maker.read(str(talking_clip), pytest.fail)
    read, shown = waiting.maker.model, Waiting(faces[0]).show(faces[0], 0.0)
    assert read is not None and shown is not None
    assert read.version.packet == shown.version.packet


def test_a_file_without_a_face_is_left_once_somebody_has_come(
    faces: list[Picture], noise: Path
) -> None:
    waiting, busy = Waiting(faces[0]), iter([True, False])
    waiting.maker.read(str(noise), lambda: next(busy))
    assert waiting.maker.model is None and next(busy, None) is None
