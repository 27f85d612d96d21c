"""Scheduling of incremental mode learning in a live call, within a byte budget."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace

from encoder.learning.face_sample import FaceSample
from encoder.learning.incremental_modes import (
    BYTES_PER_S,
    LearnedMode,
    window_samples,
)

# Learns modes from samples, within a byte budget, at most so many.
LearnModes = Callable[[Sequence[FaceSample], float, int], "Future[list[LearnedMode]]"]


class ModeScheduler:
    """Collects recent samples and has modes learned from them.

    fps: of the source.
    interval_s: time from one update to the next, at least.
    samples_per_s: of the call's time.
    one_by_one: an update has one mode, and the next one follows at once while samples show more:
        the first can be used while the next is learned.
    """

    def __init__(
        self,
        fps: float,
        interval_s: float,
        samples_per_s: float,
        learn: LearnModes,
        one_by_one: bool = False,
    ) -> None:
        self._fps, self._interval_s, self._learn = fps, interval_s, learn
        self._frames_per_sample, self._window = fps / samples_per_s, window_samples(samples_per_s)
        self._one_by_one, self._is_unfinished = one_by_one, False
        self._recent_samples: deque[FaceSample] = deque(maxlen=self._window)
        self._new_samples = deque[FaceSample](maxlen=self._window)
        self._job: Future[list[LearnedMode]] | None = None
        self._last_sample = self._last_update = float("-inf")
        self._byte_budget = 0.0

    def start(self) -> None:
        """Begin with another version's modes; the result of a running job is dropped."""
        self._new_samples.clear()
        # A learner for a new model starts with half of the last window.
        newest = list(self._recent_samples)[-(self._window // 2) :]
        self._new_samples.extend(replace(sample, face=None) for sample in newest)
        self._job, self._is_unfinished = None, False

    def wants_sample(self, index: int) -> bool:
        """Whether source frame `index` should be added."""
        return index - self._last_sample >= self._frames_per_sample

    def add_sample(self, index: int, sample: FaceSample) -> None:
        """Add a sample of source frame `index`."""
        self._last_sample = index
        self._recent_samples.append(sample)
        self._new_samples.append(sample)

    def take_modes(self, index: int, max_modes: int, may_start: bool) -> list[LearnedMode]:
        """The modes learned by source frame `index`.

        max_modes: of a new update.  may_start: whether an update may start now.
        """
        modes = self._take_finished()
        max_modes -= len(modes)
        if self._job is not None:
            return modes
        early = index - self._last_update < self._interval_s * self._fps
        is_due = self._is_unfinished or (self._new_samples and not early)
        if not is_due or not may_start or max_modes <= 0:
            return modes
        earned = BYTES_PER_S * min(1.0, (index - self._last_update) / self._fps)
        self._byte_budget = min(self._byte_budget + earned, BYTES_PER_S)
        self._last_update = index
        samples = list(self._new_samples)
        self._new_samples.clear()
        most = 1 if self._one_by_one else max_modes
        self._job = self._learn(samples, self._byte_budget, most)
        return modes + self._take_finished()

    def _take_finished(self) -> list[LearnedMode]:
        if self._job is None or not self._job.done():
            return []
        modes, self._job = self._job.result(), None
        self._byte_budget -= sum(len(mode.data) for mode in modes)
        self._is_unfinished = self._one_by_one and bool(modes) and self._byte_budget > 0
        return modes
