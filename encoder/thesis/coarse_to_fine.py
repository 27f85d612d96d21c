"""Fit of a person's textures to a frame, coarse to fine, from several initial faces."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from encoder.fitting.analysis_by_synthesis import Observation
from encoder.fitting.fit_results import TextureFit
from encoder.thesis.detection_measurement import FrameMeasurement
from encoder.thesis.person_texture import GOOD_CORRELATION, PersonTexture
from shared_model.arrays import Picture
from shared_model.parameters import EAU_INDEX, FaceParameters, clip_eau

# Frames between fits from all initial faces; a poor fit is always repeated from all of them.
ALTERNATIVES_INTERVAL = 4
# Increase of the correlation for which an alternative replaces the fit from the first face.
MIN_CORRELATION_GAIN = 0.01

# The fields of the mouth's corners differ in both directions, and a fit may converge near rest from
# the wrong side.  At this interval, a fit with the corners within `NEAR_REST` is repeated from
# `OPPOSITE_EAU` on the other side.
MOUTH_CORNERS = EAU_INDEX["mouth_corners"]
OPPOSITE_EAU, NEAR_REST = 0.4, 0.2
OPPOSITE_INTERVAL = 6
# Relative decrease of the residual for which the repeated fit replaces the first one.
MIN_IMPROVEMENT = 0.02

# Middle and inner brow move the skin almost alike (cosine .97), and a fit may converge far off
# along the direction in which they cancel out, with a residual that is hardly larger.  At this
# interval it is repeated from either side along that direction.
BROWS = EAU_INDEX["eyebrow_middle"], EAU_INDEX["eyebrow_inner"]
BROW_STEP = 0.36, -0.6
BROWS_INTERVAL, MIN_BROW_IMPROVEMENT = 3, 0.003


def fit_coarse_to_fine(
    textures: Sequence[PersonTexture],
    luma: Picture,
    starts: Sequence[FaceParameters],
    active: Sequence[int],
    iterations: Sequence[int],
    frame_number: int,
) -> TextureFit:
    """Fit all textures in turn; the next, finer one starts from the best fit so far.

    starts: initial faces, the most likely one first.  iterations: of each texture.
    frame_number: decides about the alternatives that are not tried in every frame.
    """
    for texture, count in zip(textures, iterations, strict=True):
        observation = texture.observe(luma, starts[0])
        best = texture.fit(observation, starts[0], active, count)
        if frame_number % ALTERNATIVES_INTERVAL == 0 or best.correlation < GOOD_CORRELATION:
            fits = [texture.fit(observation, face, active, count) for face in starts[1:]]
            other = max(fits, key=lambda fit: fit.correlation, default=best)
            if other.correlation > best.correlation + MIN_CORRELATION_GAIN:
                best = other
        if texture is textures[0] and frame_number % OPPOSITE_INTERVAL == 0:
            others, gain = opposite_starts(best.face, active), MIN_IMPROVEMENT
            best = _best(texture, observation, best, others, active, count, gain)
        if texture is textures[0] and frame_number % BROWS_INTERVAL == 0:
            others, gain = brow_starts(best.face, active), MIN_BROW_IMPROVEMENT
            best = _best(texture, observation, best, others, active, count, gain)
        texture.update_noise_level(best)
        starts = [best.face]
    return best


def initial_faces(
    start: FaceParameters, measurement: FrameMeasurement | None
) -> list[FaceParameters]:
    """Initial faces of the fit: with landmarks, also their expression, and their whole face."""
    if measurement is None:
        return [start]
    return [start, replace(start, eau=measurement.face.eau), measurement.face]


def _best(
    texture: PersonTexture,
    observation: Observation,
    fit: TextureFit,
    starts: Sequence[FaceParameters],
    active: Sequence[int],
    iterations: int,
    min_improvement: float,
) -> TextureFit:
    """The best of a fit and those from other starts, if it leaves so much less than the first."""
    others = [texture.fit(observation, start, active, iterations) for start in starts]
    best = min(others, key=lambda other: other.residual_mse_grey2, default=fit)
    is_better = best.residual_mse_grey2 < (1 - min_improvement) * fit.residual_mse_grey2
    return best if is_better else fit


def opposite_starts(face: FaceParameters, active: Sequence[int]) -> list[FaceParameters]:
    """The face with the mouth's corners on the other side of rest, if they are near it."""
    if MOUTH_CORNERS not in active or abs(face.eau[MOUTH_CORNERS]) > NEAR_REST:
        return []
    corners = np.arange(len(face.eau)) == MOUTH_CORNERS
    eau = -OPPOSITE_EAU if face.eau[MOUTH_CORNERS] >= 0 else OPPOSITE_EAU
    return [replace(face, eau=np.where(corners, eau, face.eau))]


def brow_starts(face: FaceParameters, active: Sequence[int]) -> list[FaceParameters]:
    """The face with its brows further along the direction in which their actuators cancel out."""
    if not set(BROWS) <= set(active):
        return []
    step = np.zeros(len(face.eau))
    step[list(BROWS)] = BROW_STEP
    return [replace(face, eau=clip_eau(face.eau + sign * step)) for sign in (1, -1)]
