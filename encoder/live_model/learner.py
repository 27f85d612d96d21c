"""What learns while a live call's frames go on: updates of the model, and modes one by one."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import Background, encoded_in_a_thread
from encoder.coding.gop import GopStructure
from encoder.learning.face_sample import FaceSample
from encoder.learning.hidden_faces import HandWatch
from encoder.learning.incremental_modes import LearnedMode, ModeLearner, ModeLimits
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.warm_up import is_loaded, warm_up
from shared_model.arrays import Array, Picture
from shared_model.surround import head_with_surround

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class TrainingTask:
    """An update to train, see `ModelTrainer.retrain`."""

    share: float
    pictures: Sequence[Picture]
    points: Sequence[Array]
    number: int


@dataclass(frozen=True, slots=True)
class ModesTask:
    """Modes to learn, see `ModeLearner.update`.  Samples without a face are fitted first."""

    samples: Sequence[FaceSample]
    byte_budget: float
    max_modes: int


class Learner(Protocol):
    """Trains and learns in the order of the calls; what it returns may be done later."""

    def encode_background(self, background: Background, max_bytes: int) -> "Future[bytes]":
        """Encode a background, see `EncodeBackground`."""

    def begin(self, trainer: ModelTrainer) -> None:
        """Go on with a trainer that has made its first version."""

    def train(self, task: TrainingTask) -> "Future[ModelVersion]":
        """Train an update."""

    def start_modes(self, version: ModelVersion, samples_per_s: float, limits: ModeLimits) -> None:
        """Learn the modes that `version` lacks from now on, see `ModeLearner`."""

    def learn(self, task: ModesTask) -> "Future[list[LearnedMode]]":
        """Learn modes of the version of the last `start_modes`, which has them from then on."""

    def close(self) -> None:
        """Leave what is under way."""


class LocalLearner:
    """A `Learner` in this process.

    training, learning: train updates and learn modes in the background; None: at once, so that the
        same source gives the same bytes.
    """

    def __init__(self, training: Executor | None = None, learning: Executor | None = None) -> None:
        self._training, self._learning = training, learning
        self._trainer: ModelTrainer | None = None
        self._modes: _VersionModes | None = None
        self._hands = HandWatch()

    def warm_up(self, video: VideoFormat, gop: GopStructure) -> None:
        """Run the work of a call from such a source once unless all is loaded, see `warm_up`; load
        the networks.
        """
        if not is_loaded():
            warm_up(head_with_surround(), video, gop)
        blank = np.zeros((video.height, video.width, 3), np.uint8)
        self._hands.find(blank, np.array([(0, 0), (video.width, video.height)]))

    def encode_background(self, background: Background, max_bytes: int) -> "Future[bytes]":
        """See `Learner`."""
        return encoded_in_a_thread(background, max_bytes)

    def begin(self, trainer: ModelTrainer) -> None:
        """See `Learner`."""
        self._trainer = trainer

    def train(self, task: TrainingTask) -> "Future[ModelVersion]":
        """See `Learner`."""
        assert self._trainer is not None
        retrain = self._trainer.retrain
        work = partial(retrain, task.share, task.pictures, task.points, task.number)
        return _submit(self._training, work)

    def start_modes(self, version: ModelVersion, samples_per_s: float, limits: ModeLimits) -> None:
        """See `Learner`."""
        learner = ModeLearner(version.person, samples_per_s, limits)
        self._modes = _VersionModes(version, learner, self._hands)

    def learn(self, task: ModesTask) -> "Future[list[LearnedMode]]":
        """See `Learner`."""
        assert self._modes is not None
        return _submit(self._learning, partial(self._modes.learn, task))

    def close(self) -> None:
        """See `Learner`."""
        for executor in (self._training, self._learning):
            if executor is not None:
                executor.shutdown(cancel_futures=True)


def _submit(executor: Executor | None, work: Callable[[], Result]) -> "Future[Result]":
    if executor is not None:
        return executor.submit(work)
    done = Future[Result]()
    done.set_result(work())
    return done


class _VersionModes:
    """Learns the modes of one version."""

    def __init__(self, version: ModelVersion, learner: ModeLearner, hands: HandWatch) -> None:
        self._version, self._learner, self._hands = version, learner, hands

    def learn(self, task: ModesTask) -> list[LearnedMode]:
        modes = self._learner.update(
            task.samples,
            self._version.fit_texels,
            task.byte_budget,
            task.max_modes,
            self._hands.hide,
        )
        for mode in modes:
            self._version = self._version.with_mode_of_texels(mode)
        return modes
