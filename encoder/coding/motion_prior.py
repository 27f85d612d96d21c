"""A Gaussian-process prior on a person's motion, and the transform designed from its moments.

A live call has seen a few seconds of a person.  Their covariance is shrunk towards independence,
since a short sample has spurious correlations, and a prior covariance is added, since what has not
moved yet may move later.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.coding.transform import (
    INNOVATION_LAG,
    VARIANCE_WEIGHT,
    WhitenedSpace,
    prediction_errors,
    principal_axes,
    scale_codes,
)
from protocol.frames.frame_transform import GEOMETRY_SIZE, FrameTransform
from protocol.frames.temporal_prediction import INTRA, PREDICTION_KINDS
from shared_model.arrays import Array, Integers
from shared_model.parameters import LIDS

# Two standard deviations of the prior: degrees, mm, log depth, EAUs.
PRIOR_MOTION_2SIGMA = np.array([4.0, 4.0, 3.0, 15.0, 15.0, 0.04, *[0.6] * (GEOMETRY_SIZE - 6)])
# Prior correlation of both eyelids, so that a blink is one component.
EYELID_CORRELATION = 0.95
# Shrinkage of the sample covariance towards its diagonal.
SHRINKAGE = 0.1
# Motion is the sum of a slow and a fast process.  Each is noise through two equal first-order
# low-passes with this decay per source frame.  The share of variance in the slow process.
SLOW_DECAY, FAST_DECAY = 0.93, 0.7
POSE_SLOW_SHARE, FACE_SLOW_SHARE = 0.9, 0.5
# Standard deviation of the measurement noise of each value, in units of the whitened space.
MEASUREMENT_NOISE = 0.3
# Mean absolute value of a standard normal variable.
_MEAN_ABSOLUTE = np.sqrt(2 / np.pi)
# Fixed-point 1 for the integers of `interpolate`, so large that its floors are negligible.
_ONE = 1 << 20


@dataclass(frozen=True, slots=True)
class GaussianProcess:
    """A stationary process: white noise through two equal first-order low-passes.

    covariance: (d, d) of y.  decay: of each low-pass per source frame.
    """

    covariance: Array
    decay: float

    def autocorrelation(self, lag: Integers | int) -> Array:
        """Autocorrelation at a lag, source frames."""
        growth = lag * (1 - self.decay**2) / (1 + self.decay**2)
        return np.asarray(self.decay**lag * (1 + growth))

    def prediction_error_power(self, taps: Array, frame_step: int) -> float:
        """Variance of a filtered process of unit variance.

        taps: (n,) of a prediction-error filter, `frame_step` source frames apart.
        """
        times = np.arange(len(taps)) * frame_step
        return float(taps @ self.autocorrelation(np.abs(times[:, None] - times)) @ taps)


def transform_from_prior(
    vectors: Array,
    distortion: Array,
    modes: tuple[bytes, ...],
    frames_per_packet: int,
    frame_step: int,
    layer_variance: Array | None = None,
) -> FrameTransform:
    """The transform for the rest of a call, with all d components.

    vectors: (t, d) y of some frames so far, in any order.
    distortion: (d, d), see `DistortionModel`.
    frame_step: source frames from one coded frame to the next.
    layer_variance: prior variance of the layer coefficients; None: they have none.
    """
    processes = motion_processes(vectors, layer_variance)
    space = WhitenedSpace.from_distortion(vectors.mean(0), distortion)
    covariances = [space.root.T @ process.covariance @ space.root for process in processes]
    motion = np.zeros_like(distortion)
    for process, covariance in zip(processes, covariances, strict=True):
        difference = 2 * (1 - process.autocorrelation(INNOVATION_LAG * frame_step))
        motion += (difference + VARIANCE_WEIGHT) * covariance
    axes = principal_axes(motion)
    # Rounding makes a variance of 0 negative.
    variances = [np.maximum(((covariance @ axes) * axes).sum(0), 0.0) for covariance in covariances]
    transform = space.frame_transform(modes, axes, np.sqrt(np.sum(variances, axis=0)))
    power = _prediction_error_powers(processes, variances, frames_per_packet, frame_step)
    return replace(transform, scale_codes=scale_codes(_MEAN_ABSOLUTE * np.sqrt(power)))


def _prediction_error_powers(
    processes: Sequence[GaussianProcess],
    variances: Sequence[Array],
    frames_per_packet: int,
    frame_step: int,
) -> Array:
    """(n, PREDICTION_KINDS) prediction error power of components, with measurement noise.

    variances: (n,) of the components in each process.
    """
    power = np.zeros((len(variances[0]), PREDICTION_KINDS))
    for kind, filters in enumerate(prediction_error_filters(frames_per_packet)):
        for process, variance in zip(processes, variances, strict=True):
            power[:, kind] += variance * np.mean(
                [process.prediction_error_power(taps, frame_step) for taps in filters]
            )
        power[:, kind] += MEASUREMENT_NOISE**2 * np.mean([taps @ taps for taps in filters])
    return power


def motion_processes(
    vectors: Array, layer_variance: Array | None = None
) -> tuple[GaussianProcess, GaussianProcess]:
    """The slow and the fast process of y, from some frames (t, d).  layer_variance: see above.

    The cross-covariance of pose and face shrinks, since their shares of slow motion differ.
    """
    covariance = np.zeros((vectors.shape[1],) * 2) if len(vectors) == 1 else np.cov(vectors.T)
    covariance = (1 - SHRINKAGE) * covariance + SHRINKAGE * np.diag(np.diag(covariance))
    covariance[:GEOMETRY_SIZE, :GEOMETRY_SIZE] += prior_covariance()
    if layer_variance is not None:
        layers = GEOMETRY_SIZE + np.arange(len(layer_variance))
        covariance[layers, layers] += layer_variance
    slow = np.full(len(covariance), FACE_SLOW_SHARE)
    slow[:6] = POSE_SLOW_SHARE
    return (
        GaussianProcess(covariance * np.sqrt(np.outer(slow, slow)), SLOW_DECAY),
        GaussianProcess(covariance * np.sqrt(np.outer(1 - slow, 1 - slow)), FAST_DECAY),
    )


def prior_covariance() -> Array:
    """(GEOMETRY_SIZE, GEOMETRY_SIZE) prior covariance of pose and EAUs."""
    left, right = (6 + index for index in LIDS)
    correlation = np.eye(GEOMETRY_SIZE)
    correlation[left, right] = correlation[right, left] = EYELID_CORRELATION
    return np.asarray(correlation * np.outer(PRIOR_MOTION_2SIGMA, PRIOR_MOTION_2SIGMA) / 4)


def prediction_error_filters(frames_per_packet: int) -> list[list[Array]]:
    """Prediction-error filters by prediction kind: taps (n + 1,) on the frames from the anchor on.

    A kind without frames in such a packet has the filters of the kind before.
    """
    frames = _ONE * np.eye(frames_per_packet + 1, dtype=np.int64)
    filters: list[list[Array]] = [[] for _ in range(PREDICTION_KINDS)]
    filters[INTRA].append(frames[0] / _ONE)
    for kind, error in prediction_errors(frames):
        filters[kind].append(error / _ONE)
    for kind in range(1, PREDICTION_KINDS):
        filters[kind] = filters[kind] or filters[kind - 1]
    return filters
