"""Refinement of the identity during a call, from keyframes at different poses and expressions.

The most diverse frames become keyframes.  At scheduled times, bundle adjustment fits the identity
of the first frame to them in the background.  Every third keyframe only validates: unless the
adjusted identity explains these better, it is dropped.
"""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np

from encoder.fitting.analysis_by_synthesis import Observation
from encoder.fitting.fit_results import IdentityFit
from encoder.thesis.bundle_adjustment import PhotometricBundleAdjustment
from encoder.thesis.person_texture import PersonTexture
from runtime.parallel import low_priority_executor
from shared_model import geometry
from shared_model.arrays import Array, Picture
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters, with_focal_change

# Seconds with a face after which the identity is adjusted, and the delay of the result: twice what
# the adjustment takes in the background of a call on two cores.
SCHEDULE_S = (2.0, 8.0)
LATENCY_S = 2.5
MAX_KEYFRAMES = 12
VALIDATION_EVERY = 3
# Smaller faces determine their shape too poorly.
MIN_EYE_DISTANCE_PX = 25.0
# Relative decrease of the residual in the validation keyframes that is worth an update.
MIN_IMPROVEMENT = 0.03
# Rotation and root sum of squares of actuators that count as the same distance.
DISTANCE_SCALE_RAD, DISTANCE_SCALE_EAU = 0.35, 0.7
MIN_KEYFRAME_DISTANCE = 0.15


@dataclass(frozen=True, slots=True)
class Keyframe:
    """An observed frame, the face in it, and its `pose_descriptor`."""

    observation: Observation
    face: FaceParameters
    descriptor: Array


class KeyframeSet:
    """At most `MAX_KEYFRAMES` keyframes, the most diverse of the candidates."""

    def __init__(self) -> None:
        self._keyframes: list[Keyframe] = []

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The keyframes, oldest first."""
        return tuple(self._keyframes)

    def wants(self, descriptor: Array) -> bool:
        """Whether a frame with this descriptor increases the diversity."""
        nearest = min(
            (_distance(descriptor, keyframe.descriptor) for keyframe in self._keyframes),
            default=np.inf,
        )
        if len(self._keyframes) < MAX_KEYFRAMES:
            return bool(nearest > MIN_KEYFRAME_DISTANCE)
        return bool(nearest > self._closest_pair()[0])

    def add(self, keyframe: Keyframe) -> None:
        """Add a keyframe; a full set drops the later one of its closest pair."""
        if len(self._keyframes) == MAX_KEYFRAMES:
            del self._keyframes[self._closest_pair()[1]]
        self._keyframes.append(keyframe)

    def change_focal(self, ratio: float) -> None:
        """Convert all faces to a focal length `ratio` times as long."""
        self._keyframes = [
            replace(keyframe, face=with_focal_change(keyframe.face, ratio))
            for keyframe in self._keyframes
        ]

    def _closest_pair(self) -> tuple[float, int]:
        """Distance of the closest pair, and the index of the later one."""
        pairs = (
            (_distance(later.descriptor, earlier.descriptor), index)
            for index, later in enumerate(self._keyframes)
            for earlier in self._keyframes[:index]
        )
        return min(pairs)


class IdentityRefiner:
    """Refines the identity of one person.

    origin: the identity in the first frame, with its information.  texture: what is fitted.
    first: the observation of the first frame.  active: actuators that move.
    """

    def __init__(
        self,
        head: Head,
        origin: IdentityFit,
        texture: PersonTexture,
        first: Observation,
        active: Sequence[int],
    ) -> None:
        self._first, self._texture, self._active = first, texture, list(active)
        self._adjustment = PhotometricBundleAdjustment(head, origin, first.target, active)
        self._current = replace(origin, frames=origin.frames[:1])
        self._keyframe_set = KeyframeSet()
        self._seconds = 0.0
        self._schedule = list(SCHEDULE_S)
        self._executor = low_priority_executor(1)
        self._pending: Future[IdentityFit | None] | None = None
        self._adopted = True

    def advance(self, elapsed_s: float) -> None:
        """Advance the schedule by one frame with a face."""
        self._seconds += elapsed_s

    def add_keyframe_candidate(self, luma: Picture, face: FaceParameters) -> None:
        """Use a well fitted frame, (h, w) luma, if it is diverse; start an adjustment when due."""
        if self._pending is not None or not self._adopted:
            return
        descriptor = pose_descriptor(face, self._active)
        if self._keyframe_set.wants(descriptor):
            observation = self._texture.observe(luma, face)
            self._keyframe_set.add(Keyframe(observation, face, descriptor))
        if self._schedule and self._seconds >= self._schedule[0]:
            del self._schedule[0]
            self._pending = self._executor.submit(
                validated_adjustment,
                self._adjustment,
                self._current,
                self._first,
                self._keyframe_set.keyframes,
            )
            self._result_due_s = self._seconds + LATENCY_S

    def take_result(self) -> IdentityFit | None:
        """A better identity, once, with the face in the first frame; None where there is none.

        The result appears a fixed number of frames after its adjustment was started, whatever the
        speed of the machine.
        """
        if self._pending is None or self._seconds < self._result_due_s:
            return None
        better, self._pending = self._pending.result(), None
        self._adopted = better is None
        return better

    def adopt(self, fitted: IdentityFit) -> None:
        """Refine the better identity from now on: the tracker uses it."""
        self._keyframe_set.change_focal(fitted.camera.focal_px / self._current.camera.focal_px)
        self._current, self._adopted = fitted, True


def validated_adjustment(
    adjustment: PhotometricBundleAdjustment,
    current: IdentityFit,
    first: Observation,
    keyframes: Sequence[Keyframe],
) -> IdentityFit | None:
    """The identity adjusted to two of three keyframes, if it explains the others better too."""
    validation = keyframes[VALIDATION_EVERY - 1 :: VALIDATION_EVERY]
    training = [each for number, each in enumerate(keyframes, 1) if number % VALIDATION_EVERY]
    if not validation:
        return None

    def with_keyframes(
        fitted: IdentityFit, chosen: Sequence[Keyframe]
    ) -> tuple[IdentityFit, list[Observation]]:
        ratio = fitted.camera.focal_px / current.camera.focal_px
        faces = (with_focal_change(keyframe.face, ratio) for keyframe in chosen)
        views = [first, *(keyframe.observation for keyframe in chosen)]
        return replace(fitted, frames=(fitted.frames[0], *faces)), views

    before = adjustment.resect(*with_keyframes(current, validation)).residual_mse_grey2
    better = adjustment.adjust(*with_keyframes(current, training)).fitted
    after = adjustment.resect(*with_keyframes(better, validation)).residual_mse_grey2
    if after > (1 - MIN_IMPROVEMENT) * before:
        return None
    return replace(better, frames=better.frames[:1])


def pose_descriptor(face: FaceParameters, active: Sequence[int]) -> Array:
    """(3 + a,) rotation and active actuators, each relative to its distance scale."""
    rotation = geometry.vector_from_quaternion(face.pose.rotation)
    eau = face.eau[list(active)]
    return np.concatenate([rotation / DISTANCE_SCALE_RAD, eau / DISTANCE_SCALE_EAU])


def _distance(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other))
