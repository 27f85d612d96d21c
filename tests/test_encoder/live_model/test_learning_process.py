"""Learning in a process of its own: the same results, and an end whatever happens."""

import os
import signal
import socket
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import cast

import numpy as np
import pytest
from processes import LIMIT_S

from encoder.capture.video_source import open_source
from encoder.coding.background import BackgroundImage
from encoder.coding.gop import gop_for_fps
from encoder.coding.model_packet import BUDGETS
from encoder.learning.incremental_modes import USUAL_LIMITS
from encoder.live_model.learner import LocalLearner, ModesTask, TrainingTask
from encoder.live_model.learning_process import SHARED, LearningProcess
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.warm_up import frontal_landmarks
from protocol.pictures.picture_codec import decode_picture
from runtime.object_stream import ObjectStream
from shared_model.geometry import Camera
from shared_model.surround import head_with_surround


def test_what_another_process_learns_is_what_this_one_learns(talking_clip: Path) -> None:
    head, failures = head_with_surround(), list[str]()
    with open_source(str(talking_clip)) as capture:
        pictures = [picture for _, picture in islice(capture, 4)]
        size = capture.width, capture.height
        points = frontal_landmarks(head, Camera(*size, max(size)))
        trainer = ModelTrainer(
            head,
            capture.format,
            gop_for_fps(capture.fps, None),
            BackgroundImage(pictures[0]),
            BUDGETS["live"],
            progressive=False,
            workers=1,
        )
    version = trainer.bootstrap(pictures[:1], [points])
    update = TrainingTask(0.3, pictures, [points] * len(pictures), 1)
    modes = ModesTask([version.sample(each, points) for each in pictures], 1200.0, 2)
    here, there = LocalLearner(), LearningProcess(failures.append)
    try:
        for learner in (there, here):
            learner.begin(trainer)
            learner.start_modes(version, 8.0, USUAL_LIMITS)
        far_update, far_modes = there.train(update), there.learn(modes)
        packet, learned = far_update.result(LIMIT_S).packet, far_modes.result(LIMIT_S)
        # Only now: training changes what the trainer knows of the person.
        near_update, near_modes = here.train(update).result(), here.learn(modes).result()
        textures = [decode_picture("it", each.texture) for each in (packet, near_update.packet)]
        # The last bits of a sum depend on the number of threads.
        assert np.abs(textures[0] - textures[1]).mean() < 0.5 and failures == []
        assert packet.version == 1 and packet.aau == near_update.packet.aau
        assert learned and len(learned) == len(near_modes)
        assert np.abs(learned[0].luma - near_modes[0].luma).mean() < 0.5
    finally:
        there.close()


def test_a_learning_process_that_dies_is_told_once_and_harms_nothing() -> None:
    lines = SimpleQueue[str]()
    process = LearningProcess(lines.put)
    try:
        os.kill(process.pid, signal.SIGKILL)
        assert "nothing more is learned" in lines.get(timeout=LIMIT_S)
        assert not process.learn(ModesTask([], 1.0, 1)).done()
    finally:
        process.close()


class FailingTrainer:
    """In the place of a `ModelTrainer`: its updates fail."""

    def retrain(self, *task: object) -> ModelVersion:
        """Raises `ValueError`."""
        raise ValueError("a fault of ours")


def test_a_fault_in_the_learning_process_is_told_and_nothing_more_is_learned() -> None:
    lines = SimpleQueue[str]()
    process = LearningProcess(lines.put)
    try:
        process.begin(cast(ModelTrainer, FailingTrainer()))
        update = process.train(TrainingTask(0.3, [], [], 1))
        line = lines.get(timeout=LIMIT_S)
        assert "has failed" in line and "nothing more is learned" in line
        assert "a fault of ours" in line and not update.done()
    finally:
        process.close()


def test_a_call_begins_without_the_learning_process(talking_clip: Path) -> None:
    lines = SimpleQueue[str]()
    with open_source(str(talking_clip)) as capture:
        picture = next(iter(capture))[1]
        process, image = LearningProcess(lines.put), BackgroundImage(picture)
        try:
            # Whether it has been sent before the process dies or not: either fails, none waits.
            before = process.encode_background(image, 2000)
            os.kill(process.pid, signal.SIGKILL)
            lines.get(timeout=LIMIT_S)
            after = process.encode_background(image, 2000)
            assert isinstance(after.exception(LIMIT_S), ChildProcessError)
            assert isinstance(before.exception(LIMIT_S), ChildProcessError | None)
            size = capture.width, capture.height
            trainer = ModelTrainer(
                head_with_surround(),
                capture.format,
                gop_for_fps(capture.fps, None),
                image,
                BUDGETS["live"],
                progressive=False,
                workers=1,
                encode_background=lambda background, size: after,
            )
            points = frontal_landmarks(head_with_surround(), Camera(*size, max(size)))
            version = trainer.bootstrap([picture], [points])
        finally:
            process.close()
    expected = image.encode(BUDGETS["live"].background_bytes)
    assert version.packet.background == expected


def test_arrays_and_heads_arrive_as_they_were() -> None:
    ours, theirs = (ObjectStream(each, SHARED) for each in socket.socketpair())
    array = np.arange(12.0).reshape(3, 4)
    ours.send((array, array.T, head_with_surround(), "text"))
    first, second, head, text = theirs.receive()
    assert np.array_equal(first, array) and np.array_equal(second, array.T) and text == "text"
    assert head is head_with_surround()
    first[0, 0] = 7
    assert array[0, 0] == 0
    ours.close()
    with pytest.raises(EOFError):
        theirs.receive()
