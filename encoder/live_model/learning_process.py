"""A `Learner` in a process of its own, so that learning never holds the interpreter of the frames.

The process is started once for a call and has a lower priority.  It ends with the call, and with
the process that started it.
"""

import os
import signal
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import Background
from encoder.coding.gop import GopStructure
from encoder.learning.incremental_modes import LearnedMode, ModeLimits
from encoder.live_model.learner import LocalLearner, ModesTask, TrainingTask
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.warm_up import is_loaded, warm_up
from protocol.model_packet import ModelPacket
from runtime.parallel import (
    low_priority_executor,
    lower_priority_of_process,
    short_switch_interval,
)
from runtime.remote_calls import RemoteCalls, answer_calls
from shared_model.mesh import generic_head
from shared_model.surround import head_with_surround

# An update may come half a second later, a mode must not: with 2 a mode takes a third longer while
# an update is trained.
TRAINING_NICENESS = 9
# Heads are large, and both processes have them.
SHARED = {"generic head": generic_head, "head with surround": head_with_surround}


class LearningProcess:
    """A `Learner` in a process of its own.

    on_failure: called once with a line if the process ends by itself, cannot be understood or
        fails; nothing more is learned.
    """

    def __init__(self, on_failure: Callable[[str], None]) -> None:
        def fail(reason: str) -> None:
            on_failure(f"{reason}: nothing more is learned")

        self._calls = RemoteCalls(__name__, fail, SHARED)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._calls.pid

    def warm_up(
        self, video: VideoFormat, gop: GopStructure, is_drawn: bool
    ) -> tuple[ModelPacket, bytes] | None:
        """Warm up the learning process and its caller for a source, see `warm_up`, as far as they
        are not loaded.

        is_drawn: what that returns is wanted; else it may be None.
        """
        other = self._calls.call_awaited("warm_up", video, gop)
        needs_work = is_drawn or not is_loaded()
        drawn = warm_up(head_with_surround(), video, gop) if needs_work else None
        wait([other])
        return drawn

    def encode_background(self, background: Background, max_bytes: int) -> "Future[bytes]":
        """See `Learner`.

        A call waits for this: it fails with `ChildProcessError` if the process is gone or has
        failed, where other results are never done.
        """
        return self._calls.call_awaited("encode_background", background, max_bytes)

    def begin(self, trainer: ModelTrainer) -> None:
        """See `Learner`."""
        self._calls.call("begin", trainer)

    def train(self, task: TrainingTask) -> "Future[ModelVersion]":
        """See `Learner`."""
        return self._calls.call("train", task)

    def start_modes(self, version: ModelVersion, samples_per_s: float, limits: ModeLimits) -> None:
        """See `Learner`."""
        self._calls.call("start_modes", version, samples_per_s, limits)

    def learn(self, task: ModesTask) -> "Future[list[LearnedMode]]":
        """See `Learner`."""
        return self._calls.call("learn", task)

    def close(self) -> None:
        """End the process; closing twice has no further effect."""
        self._calls.close()


def serve(descriptor: int) -> None:
    """Learn for the process at the other end of a socket until it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lower_priority_of_process()
    training = low_priority_executor(1, TRAINING_NICENESS)
    # Modes are learned beside the training of an update: neither may hold the interpreter for long.
    with short_switch_interval():
        learner = LocalLearner(training, ThreadPoolExecutor(1))
        answer_calls(descriptor, learner, SHARED)
    # What is under way is of no use any more.
    os._exit(0)
