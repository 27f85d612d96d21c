"""The states of a live call's model: one table, in words and as data."""

import io
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from encoder.calls import model_states
from encoder.calls.model_lifecycle import ModelLifecycle
from encoder.calls.model_states import TRANSITIONS, ModelState
from encoder.calls.model_updates import ModelUpdateSender
from encoder.calls.packet_sender import PacketSender
from encoder.calls.session_callbacks import CallEvents
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import BUDGETS
from encoder.live_model.call_trainer import CallTrainers
from encoder.live_model.learner import LocalLearner
from encoder.live_model.other_face import FaceChoice
from encoder.live_model.pacing import UNPACED
from protocol.call_file import CallStreamWriter


def test_the_table_in_the_docstring_is_the_one_of_the_program() -> None:
    words = str(model_states.__doc__)
    rows = [line.strip("| ").split(" | ") for line in words.splitlines() if line.startswith("| ")]
    told = {row[0]: set(re.findall("[A-Z_]{4,}", row[3])) for row in rows[2:] if len(row) == 4}
    # The call may end in any state: no row says so.
    following = {
        state.name: {each.name for each in states} - {"ENDED"}
        for state, states in ((state, after.values()) for state, after in TRANSITIONS.items())
    }
    assert told | {"ENDED": set()} == following
    assert all(ModelState.ENDED in TRANSITIONS[state].values() for state in list(ModelState)[:-1])


def test_every_state_can_be_reached() -> None:
    reached = {ModelState.SEARCHING}
    for _ in ModelState:
        reached |= {after for before in reached for after in TRANSITIONS[before].values()}
    assert reached == set(ModelState)


def test_a_call_without_a_face_has_no_version_and_ends_once(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((8, 8, 3), np.uint8))
    stats, gop = SessionStats(), GopStructure()
    with open_source(str(tmp_path / "%d.png")) as capture, CallStreamWriter(io.BytesIO()) as sink:
        updates = ModelUpdateSender(PacketSender(sink, stats), stats, gop, 25.0)
        trainers = CallTrainers(capture.format, gop, BUDGETS["live"], UNPACED)
        learner, shown, events = LocalLearner(), FaceChoice(), CallEvents()
        model = ModelLifecycle(25.0, trainers, updates, stats, learner, shown, events, lambda: 0.0)
        assert model.state is ModelState.SEARCHING
        with pytest.raises(ValueError, match="no face"):
            _ = model.version
        model.end()
        with pytest.raises(ValueError, match="does not end"):
            model.end()
    assert not stats.sent.packets
