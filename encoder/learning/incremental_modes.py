"""Incremental learning of appearance modes during a live call.

The next mode is the leading direction of what the model leaves of the last seconds' samples.  It is
coded like the modes of the model packet and sent at once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from encoder.appearance.masks import root_weight_and_support
from encoder.learning.face_sample import FaceSample
from encoder.learning.hidden_faces import HandSuspicion
from encoder.learning.orthogonal_residual import OrthogonalResidual
from encoder.learning.person_model import PersonModel
from encoder.learning.sample_fitting import sample_faces
from encoder.picture_coding.picture_encoder import EncodedPicture, encode_mode, retained_energy
from protocol.frames.frame_transform import RESERVED_MODE_GREY
from protocol.pictures.picture_codec import (
    MAX_STEP_CODE,
    STEPS_PER_OCTAVE,
    ModeCodec,
    to_luma,
    to_planes,
)
from shared_model.arrays import Single
from shared_model.parameters import FaceParameters

# Samples of a sliding window, weighted down by age.
WINDOW_S = 3.0
HALF_LIFE_S = 1.0
# Bytes of modes grow by this power of those of models, and steps fall by so many each time they
# have doubled.
SCALING, STEPS_PER_DOUBLING = 1.25, 6.0
# A layer packet holds one.
LARGEST_MODE_BYTES = 12_000.0
# A mode is encoded if a pretest, without entropy coding, predicts at least this part of the share
# of the residual energy that it must explain.
PRETEST_FACTOR = 0.5
# A mode of more bytes than it may have is encoded again, so many steps coarser; the next mode
# starts as many steps finer than the last one ended.  One that is sent early is worth more than a
# fine one.
STEP_BACKOFF = 4
MIN_SAMPLES = 2


@dataclass(frozen=True, slots=True)
class ModeLimits:
    """How fine modes are, and how many bytes they may take.

    bytes_per_s: of all modes, with a reservoir of one second.  mode_bytes: of one.
    step: of the quantiser for a mode of unit scale, in steps of `picture_codec.step_size`.
    least_share: of the residual energy, that a mode must explain.
    """

    bytes_per_s: float = 2000.0
    mode_bytes: float = 800.0
    step: float = 24.0
    least_share: float = 0.025

    def scaled(self, growth: float) -> "ModeLimits":
        """The limits where models may have `growth` times the usual bytes; at most 1: these.

        Of three times as many bytes modes take four times as many, with a third of the step.
        """
        if growth <= 1:
            return self
        octaves = SCALING * np.log2(growth)
        factor = float(np.exp2(octaves))
        return ModeLimits(
            factor * self.bytes_per_s,
            min(factor * self.mode_bytes, LARGEST_MODE_BYTES),
            self.step - STEPS_PER_DOUBLING * float(octaves),
            self.least_share / factor,
        )


USUAL_LIMITS = ModeLimits()


def window_samples(samples_per_s: float) -> int:
    """How many samples the window has."""
    return round(WINDOW_S * samples_per_s)


@dataclass(frozen=True, slots=True)
class LearnedMode:
    """A coded mode, and the luma (size, size) that it adds to the texture per unit coefficient."""

    data: bytes
    luma: Single


FitSample = Callable[[FaceSample], FaceParameters]
HideHands = Callable[[FaceSample], FaceSample]


class ModeLearner:
    """Learns the modes that a person model lacks, from a sliding window of samples.

    samples_per_s: of the call's time.
    """

    def __init__(
        self, person: PersonModel, samples_per_s: float, limits: ModeLimits = USUAL_LIMITS
    ) -> None:
        self._person, self._samples_per_s, self._limits = person, samples_per_s, limits
        appearance, shape = person.appearance, person.shape
        self._texels = (shape.atlas.rows, shape.atlas.columns)
        self._mean = appearance.mean[self._texels]
        self._root, self._support = root_weight_and_support(person.weight, person.mask)
        self._mode_codec = appearance.mode_codec
        self._step_offset, self._suspicion = 0, HandSuspicion(samples_per_s)
        self._residual = OrthogonalResidual(np.zeros((0, 3 * len(shape)), np.float32))
        for image in appearance.mode_images:
            self._residual.add_mode(self._weighted(image[self._texels]))

    def update(
        self,
        samples: Sequence[FaceSample],
        fit: FitSample,
        byte_budget: float,
        max_modes: int,
        hide: HideHands | None = None,
    ) -> list[LearnedMode]:
        """Add samples, and learn modes until they take `byte_budget`, at most `max_modes`.

        fit: fits the face of a sample that has none, by the model with all modes learned so far.
        hide: hides hands in a sample; the same object if it shows none.  None: none does.
        """
        for sample in samples:
            self._add(sample, fit)
            if hide is not None and self._suspicion.is_due(float(self._residual.energies[-1])):
                without_hands = hide(sample)
                self._suspicion.note(without_hands is not sample)
                if without_hands is not sample:
                    self._residual.drop_newest_frame()
                    self._add(without_hands, fit)
            if len(self._residual) > window_samples(self._samples_per_s):
                self._residual.drop_oldest_frame()
        modes: list[LearnedMode] = []
        while len(self._residual) >= MIN_SAMPLES and byte_budget > 0 and len(modes) < max_modes:
            mode = self._learn_mode()
            if mode is None:
                break
            modes.append(mode)
            byte_budget -= len(mode.data)
        return modes

    def _add(self, sample: FaceSample, fit: FitSample) -> None:
        self._residual.add_frame(self._residual_of(sample, sample.face or fit(sample)))

    def _residual_of(self, sample: FaceSample, fitted: FaceParameters) -> Single:
        """(3 k,) weighted planes of a sample minus the mean texture, 0 at hidden texels.

        fitted: the face in the sample.
        """
        shape = self._person.shape
        sampled = sample_faces(self._person.face, shape, [sample.crop], [fitted], workers=1)
        colours = (sampled.colours[0] - self._mean) * sampled.visible[0][:, None]
        return self._weighted(np.asarray(colours, np.float32))

    def _weighted(self, colours: Single) -> Single:
        return np.asarray((to_planes(colours) * self._root).ravel(), np.float32)

    def _learn_mode(self) -> LearnedMode | None:
        """Encode the leading direction of the residual; None if it explains too little."""
        age = np.arange(len(self._residual))[::-1]
        recency = np.exp2(-age / (2 * HALF_LIFE_S * self._samples_per_s))
        direction, share = self._residual.leading_direction(recency)
        # The share of the leading direction is an upper bound for any mode's.
        least_share = self._limits.least_share
        if share < least_share:
            return None
        planes, step = self._scaled_planes(direction)
        offset = max(0, self._step_offset - STEP_BACKOFF)
        retained = retained_energy(self._mode_codec, planes, _clipped_step(step + offset))
        if share * retained < PRETEST_FACTOR * least_share:
            return None
        self._step_offset = offset
        codec, encoded = self._encode(planes, step)
        row = self._weighted(encoded.decoded[self._texels])
        if not row.any():
            return None
        before = self._residual.weighted_energy(recency)
        self._residual.add_mode(row)
        if before - self._residual.weighted_energy(recency) < least_share * before:
            self._residual.remove_last_mode()
            return None
        self._mode_codec = codec
        return LearnedMode(encoded.serialise(), to_luma(encoded.decoded))

    def _scaled_planes(self, residual_direction: Single) -> tuple[Single, int]:
        """A direction (3 k,) at the scale of a reserved mode: planes (size, size, 3) and a step."""
        direction = residual_direction.reshape(-1, 3) / self._root * self._support
        rms = np.sqrt(((direction * self._root) ** 2).sum() / (self._root**2).sum())
        scale = RESERVED_MODE_GREY / max(float(rms), 1e-3)
        size = len(self._person.appearance.mean)
        planes = np.zeros((size, size, 3), np.float32)
        planes[self._texels] = direction * np.float32(scale)
        return planes, round(self._limits.step + STEPS_PER_OCTAVE * np.log2(scale))

    def _encode(self, planes: Single, step: int) -> tuple[ModeCodec, EncodedPicture]:
        """A mode within its limits, and the codec state after it; raises the step offset."""
        while True:
            codec = self._mode_codec.copy()
            tried = _clipped_step(step + self._step_offset)
            encoded = encode_mode(codec, planes, tried)
            if encoded.size_bytes <= self._limits.mode_bytes or tried == MAX_STEP_CODE:
                return codec, encoded
            self._step_offset += STEP_BACKOFF


def _clipped_step(step: int) -> int:
    return min(max(step, 0), MAX_STEP_CODE)
