"""Tracked actuators against those of an animation: how far off, and whether the emotion is seen."""

from dataclasses import dataclass

import numpy as np

from loopback.quality.emotion_agreement import shown_emotions
from shared_model.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class ExpressionComparison:
    """found, truth: (t, len(EAUS)) actuators; nan in `found` without a face."""

    found: Array
    truth: Array

    @property
    def rms(self) -> Array:
        """(len(EAUS),) root mean square errors (eq. 5.1)."""
        return np.asarray(np.sqrt(np.nanmean((self.found - self.truth) ** 2, axis=0)))

    @property
    def same_emotion(self) -> float:
        """Share of the frames with a face that show the true emotion, or none as the truth does."""
        there = np.isfinite(self.found[:, 0])
        found, truth = (shown_emotions(each[there]) for each in (self.found, self.truth))
        return float((found == truth).mean())


def compare_expressions(found: Array, truth: Array) -> ExpressionComparison:
    """Compare the frames that both have."""
    count = min(len(found), len(truth))
    return ExpressionComparison(found[:count], truth[:count])
