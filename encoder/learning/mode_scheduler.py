"""Scheduling of incremental mode learning in a live call, within a byte budget."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

from encoder.learning.face_sample import FaceSample
from encoder.learning.incremental_modes import (
    MIN_SAMPLES,
    USUAL_LIMITS,
    LearnedMode,
    window_samples,
)

# Learns modes from samples, within a byte budget, at most so many.
LearnModes = Callable[[Sequence[FaceSample], float, int], "Future[list[LearnedMode]]"]

# What a mode is assumed to take before the first is learned, and the weight of the newest in the
# mean of those that have been.
FIRST_JOB_S, NEWEST_WEIGHT = 0.15, 0.25
# Share of the usual distance of two samples that there is in real time at least, and at most.
MIN_SPACING, MAX_SPACING = 0.5, 1.25
# Source frames from one that can be a sample to the next, in real time.
LOOK_STEP = 2


@dataclass(frozen=True, slots=True)
class FramePlace:
    """Where a source frame of a call in real time is in its packet.

    frames_to_last: source frames from it to the packet's last one.
    frames_to_coding: until the packet is coded.
    """

    frames_to_last: int
    frames_to_coding: int


class ModeScheduler:
    """Collects recent samples and has modes learned from them.

    fps: of the source.  clock: seconds from any origin.
    interval_s: time from one update to the next, at least.
    samples_per_s: of the call's time.
    one_by_one: an update has one mode, and the next one follows while samples show more: the first
        can be used while the next is learned.
    bytes_per_s: see `ModeLimits`.
    """

    def __init__(
        self,
        fps: float,
        interval_s: float,
        samples_per_s: float,
        learn: LearnModes,
        clock: Callable[[], float],
        one_by_one: bool = False,
        bytes_per_s: float = USUAL_LIMITS.bytes_per_s,
    ) -> None:
        self._bytes_per_s = bytes_per_s
        self._fps, self._interval_s, self._learn = fps, interval_s, learn
        self._clock, self._job_begin_s = clock, 0.0
        self._frames_per_sample, self._window = fps / samples_per_s, window_samples(samples_per_s)
        self._one_by_one, self._is_unfinished = one_by_one, False
        self._recent_samples: deque[FaceSample] = deque(maxlen=self._window)
        self._new_samples = deque[FaceSample](maxlen=self._window)
        self._job: Future[list[LearnedMode]] | None = None
        self._job_s, self._job_deviation_s, self._is_first_job = FIRST_JOB_S, 0.0, True
        self._last_sample = self._last_update = float("-inf")
        self._byte_budget = 0.0

    def start(self) -> None:
        """Begin with another version's modes; the result of a running job is dropped."""
        self._new_samples.clear()
        # A learner for a new model starts with half of the last window.
        newest = list(self._recent_samples)[-(self._window // 2) :]
        self._new_samples.extend(replace(sample, face=None) for sample in newest)
        self._job, self._is_unfinished = None, False

    def wants_sample(self, index: int, place: FramePlace | None = None) -> bool:
        """Whether source frame `index` should be added.

        place: of the frame.  One frame of a packet is added, the last one of which a mode should be
            there when the packet is coded; at first any.  None: frames wait for their modes.
        """
        passed = (index - self._last_sample) / self._frames_per_sample
        if place is None:
            return passed >= 1
        if self._job is not None and self._new_samples:
            # The next one would delay the job that follows.
            return False
        left, expected = place.frames_to_coding, self._expected_frames
        is_last = place.frames_to_last < LOOK_STEP or left - LOOK_STEP < expected
        is_time = self._is_first_job or (expected <= left and is_last)
        return passed >= (MIN_SPACING if is_time else MAX_SPACING)

    def add_sample(self, index: int, sample: FaceSample) -> None:
        """Add a sample of source frame `index`."""
        self._last_sample = index
        self._recent_samples.append(sample)
        self._new_samples.append(sample)

    @property
    def _expected_frames(self) -> float:
        """Source frames that a job will hardly exceed, at most those from sample to sample."""
        return min((self._job_s + self._job_deviation_s) * self._fps, self._frames_per_sample)

    def take_modes(self, index: int, max_modes: int, may_start: bool) -> list[LearnedMode]:
        """The modes learned by source frame `index`.

        max_modes: of a new update.  may_start: whether an update may start now.
        """
        modes = self._take_finished()
        max_modes -= len(modes)
        if self._job is not None:
            return modes
        early = index - self._last_update < self._interval_s * self._fps
        has_enough = len(self._recent_samples) >= MIN_SAMPLES
        has_new = bool(self._new_samples) and has_enough and not early
        is_due = has_new or (self._is_unfinished and self._may_follow(index))
        if not is_due or not may_start or max_modes <= 0:
            return modes
        earned = self._bytes_per_s * min(1.0, (index - self._last_update) / self._fps)
        self._byte_budget = min(self._byte_budget + earned, self._bytes_per_s)
        self._last_update = index
        samples = list(self._new_samples)
        self._new_samples.clear()
        most = 1 if self._one_by_one else max_modes
        self._job_begin_s = self._clock()
        self._job = self._learn(samples, self._byte_budget, most)
        return modes + self._take_finished()

    def _may_follow(self, index: int) -> bool:
        """Whether a mode that follows another is expected before the next sample."""
        next_sample = self._last_sample + self._frames_per_sample
        return index + self._expected_frames <= next_sample

    def _take_finished(self) -> list[LearnedMode]:
        if self._job is None or not self._job.done():
            return []
        modes, self._job = self._job.result(), None
        if modes:
            self._is_first_job = False
            error_s = self._clock() - self._job_begin_s - self._job_s
            self._job_s += NEWEST_WEIGHT * error_s
            self._job_deviation_s += NEWEST_WEIGHT * (abs(error_s) - self._job_deviation_s)
        self._byte_budget -= sum(len(mode.data) for mode in modes)
        self._is_unfinished = self._one_by_one and bool(modes) and self._byte_budget > 0
        return modes
