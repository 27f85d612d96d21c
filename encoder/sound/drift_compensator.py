"""Resamples a microphone's sound from the clock of its sound card to the clock of the camera."""

import numpy as np

from encoder.sound.sound_file import MAX_TIMING_ERROR_S
from shared_model.arrays import Samples

# The times of pieces jitter: how late the sound is, is averaged over about so long.
AVERAGE_S = 1.0
# Sound that is no further away stays as it is; else it is stretched or shrunk by a share at most.
DEAD_ZONE_S = 0.001
MAX_STRETCH = 0.01


class DriftCompensator:
    """Puts pieces of sound one after the other, and each where its time says.

    A clock that runs faster or slower is followed by steps of a few samples; sound that is
    `MAX_TIMING_ERROR_S` away or more is moved at once.
    position: samples from the beginning on that have been put.
    """

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz, self.position = rate_hz, 0
        self._late = 0.0  # samples, averaged

    def put(self, samples: Samples, due: float) -> Samples:
        """Samples (n,), the first due at sample `due`, stretched or cut to follow those before."""
        late, limit = due - self.position, MAX_TIMING_ERROR_S * self._rate_hz
        if abs(late) > limit:
            samples, self._late = placed(samples, round(late), limit), 0.0
        else:
            share = min(1.0, len(samples) / (AVERAGE_S * self._rate_hz))
            self._late += share * (late - self._late)
            if abs(self._late) > DEAD_ZONE_S * self._rate_hz:
                samples = self._stretched(samples)
        self.position += len(samples)
        return samples

    def fill(self, end: int) -> Samples:
        """Silence up to the sample `end`; none if that is there."""
        missing = max(0, end - self.position)
        self.position += missing
        return np.zeros(missing, np.int16)

    def _stretched(self, samples: Samples) -> Samples:
        most = max(1, int(MAX_STRETCH * len(samples)))
        more = int(np.clip(np.trunc(self._late), -most, most))
        if len(samples) < 2 or len(samples) + more < 2:
            return samples
        self._late -= more
        return resampled(samples, len(samples) + more)


def placed(samples: Samples, late: int, tolerance: float) -> Samples:
    """Samples (n,) in their place: after silence where they are late, cut where they are early.

    late, tolerance: number of samples; within the tolerance they stay as they are.
    """
    if abs(late) <= tolerance:
        return samples
    if late < 0:
        return samples[-late:]
    return np.concatenate([np.zeros(late, np.int16), samples])


def resampled(samples: Samples, count: int) -> Samples:
    """Samples (n,) in the time of `count`; both at least 2."""
    positions = np.linspace(0, len(samples) - 1, count)
    between = np.interp(positions, np.arange(len(samples)), samples)
    return np.asarray(np.rint(between), np.int16)
