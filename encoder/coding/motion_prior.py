"""How a caller may go on moving who has been seen for a few seconds only, and components for it.

Motion is taken for a Gaussian process as large as what was seen and what is usual together, so that
whatever has hardly moved yet may still move.  Components follow from the moments of the process: in
a sample of it, as long as a call is, values are alike by chance that are not by nature.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.coding.transform import (
    MOTION_FRAMES,
    VARIANCE_SHARE,
    HarmSpace,
    prediction_errors,
    principal_axes,
    spread_codes,
)
from protocol.frames.frame_transform import GEOMETRY, Components
from protocol.frames.temporal_prediction import ABSOLUTE, KINDS
from shared_model.parameters import LIDS

Array = NDArray[np.float64]

# How far callers move who have not yet moved, two standard deviations: degrees, mm, log depth,
# actuators.
USUAL_MOTION = np.array([4.0, 4.0, 3.0, 15.0, 15.0, 0.04, *[0.6] * (GEOMETRY - 6)])
# How alike both lids move: a blink then is one component rather than two.
LIDS_ALIKE = 0.95
# What of the likeness of values in a few frames is chance.
CHANCE = 0.1
# Motion is smooth: noise through two low-passes, each of which keeps this much from source frame to
# source frame.  Heads move slowly, faces quickly: how much of their variance is slow motion.
SLOW, QUICK = 0.93, 0.7
SLOW_POSE, SLOW_FACE = 0.9, 0.5
# What measuring adds to each value, in units of harm.
MEASURING_UNITS = 0.3
# The mean size of a Gaussian value of variance 1.
_MEAN_SIZE = np.sqrt(2 / np.pi)
# What stands for 1 in the integers of `interpolate`; its floors then cost next to nothing.
_WHOLE = 1 << 20


@dataclass(frozen=True, slots=True)
class Process:
    """A smooth Gaussian process.

    covariance: (d, d) of y.  kept: what each of two low-passes keeps from one source frame to the
        next.
    """

    covariance: Array
    kept: float

    def likeness(self, frames: NDArray[np.int64] | int) -> Array:
        """Correlation of y with y so many source frames later."""
        growth = frames * (1 - self.kept**2) / (1 + self.kept**2)
        return np.asarray(self.kept**frames * (1 + growth))

    def power(self, error: Array, frame_step: int) -> float:
        """Mean square of the error of a prediction, see `errors_by_kind`, where y's is 1."""
        places = np.arange(len(error)) * frame_step
        return float(error @ self.likeness(np.abs(places[:, None] - places)) @ error)


def expected_components(
    vectors: Array,
    harm: Array,
    modes: tuple[bytes, ...],
    frames_per_packet: int,
    frame_step: int,
) -> Components:
    """Components for what is yet to come of a caller.  None is left out.

    vectors: (t, d) y of some frames so far, in any order.  harm: (d, d), see `Sensitivity.harm`.
    frame_step: source frames from one coded frame to the next.
    """
    processes = expected_motion(vectors)
    space = HarmSpace.about(vectors.mean(0), harm)
    covariances = [space.root.T @ process.covariance @ space.root for process in processes]
    moves = np.zeros_like(harm)
    for process, covariance in zip(processes, covariances, strict=True):
        moved = 2 * (1 - process.likeness(MOTION_FRAMES * frame_step))
        moves += (moved + VARIANCE_SHARE) * covariance
    axes = principal_axes(moves)
    # What has not moved may come out below nothing by rounding.
    variance = [np.maximum(((covariance @ axes) * axes).sum(0), 0.0) for covariance in covariances]
    power = np.zeros((len(harm), KINDS))
    for kind, errors in enumerate(errors_by_kind(frames_per_packet)):
        for process, along in zip(processes, variance, strict=True):
            power[:, kind] += along * np.mean([process.power(e, frame_step) for e in errors])
        power[:, kind] += MEASURING_UNITS**2 * np.mean([error @ error for error in errors])
    components = space.components(modes, axes, np.sqrt(np.sum(variance, axis=0)))
    return replace(components, spreads=spread_codes(_MEAN_SIZE * np.sqrt(power)))


def expected_motion(vectors: Array) -> tuple[Process, Process]:
    """How y (t, d) of some frames may go on about its mean: slowly and, beside, quickly.

    Of what pose and all else were seen to have in common a tenth is lost: they differ in speed.
    """
    covariance = np.zeros((vectors.shape[1],) * 2) if len(vectors) == 1 else np.cov(vectors.T)
    covariance = (1 - CHANCE) * covariance + CHANCE * np.diag(np.diag(covariance))
    covariance[:GEOMETRY, :GEOMETRY] += usual_covariance()
    slow = np.full(len(covariance), SLOW_FACE)
    slow[:6] = SLOW_POSE
    return (
        Process(covariance * np.sqrt(np.outer(slow, slow)), SLOW),
        Process(covariance * np.sqrt(np.outer(1 - slow, 1 - slow)), QUICK),
    )


def usual_covariance() -> Array:
    """(GEOMETRY, GEOMETRY) of pose and actuators of callers who have not yet moved."""
    left, right = (6 + index for index in LIDS)
    alike = np.eye(GEOMETRY)
    alike[left, right] = alike[right, left] = LIDS_ALIKE
    return np.asarray(alike * np.outer(USUAL_MOTION, USUAL_MOTION) / 4)


def errors_by_kind(frames_per_packet: int) -> list[list[Array]]:
    """By kind: the errors of its predictions, as weights (n + 1,) of the frames from the anchor on.

    A kind that no frame of such a packet has has those of the kind before.
    """
    frames = _WHOLE * np.eye(frames_per_packet + 1, dtype=np.int64)
    found: list[list[Array]] = [[] for _ in range(KINDS)]
    found[ABSOLUTE].append(frames[0] / _WHOLE)
    for kind, error in prediction_errors(frames):
        found[kind].append(error / _WHOLE)
    for kind in range(1, KINDS):
        found[kind] = found[kind] or found[kind - 1]
    return found
