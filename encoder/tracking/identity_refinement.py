"""A better identity of a caller who is followed, from views of them that differ.

While frames go by, the most different ones are kept.  At times what the first frame said of shape
and lens is adjusted to them (`bundle_adjustment`), beside the frames.  Every third view only
checks: unless the adjusted identity explains these better, the one before stays.
"""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.fitting.analysis_by_synthesis import Observation
from encoder.fitting.bundle_adjustment import PhotometricBundleAdjustment
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.person_texture import PersonTexture
from encoder.runtime.parallel import low_priority_executor
from shared_model import geometry
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters, refocused

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# Seconds of face after which the identity is adjusted, and how long that may take: twice what it
# does beside a call on two cores.
SCHEDULE_S = (2.0, 8.0)
LATENCY_S = 2.5
MAX_KEYFRAMES = 12
VALIDATION_EVERY = 3
# Pictures of faces whose eyes are nearer to each other show too little of shape.
MIN_EYE_DISTANCE_PX = 25.0
# By so much less of the checking views an identity must leave to be worth an update.
MIN_IMPROVEMENT = 0.03
# Views that differ by one of these are equally far apart, root mean square.
DISTANCE_SCALE_RAD, DISTANCE_SCALE_EAU = 0.35, 0.7
MIN_KEYFRAME_DISTANCE = 0.15


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A view that was kept, the face in it, and where that is among others, see `place_of`."""

    observation: Observation
    face: FaceParameters
    descriptor: Array


class KeyframeSet:
    """At most `MOST_VIEWS` views, the most different of those that were offered."""

    def __init__(self) -> None:
        self._kept: list[Keyframe] = []

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The views, oldest first."""
        return tuple(self._kept)

    def wants(self, place: Array) -> bool:
        """Whether a view at this place would be kept."""
        nearest = min((_apart(place, kept.descriptor) for kept in self._kept), default=np.inf)
        if len(self._kept) < MAX_KEYFRAMES:
            return bool(nearest > MIN_KEYFRAME_DISTANCE)
        return bool(nearest > self._closest()[0])

    def add(self, view: Keyframe) -> None:
        """Keep a view that is wanted, instead of one of the two that differ least."""
        if len(self._kept) == MAX_KEYFRAMES:
            del self._kept[self._closest()[1]]
        self._kept.append(view)

    def refocus(self, ratio: float) -> None:
        """The focal length is `ratio` times as long now."""
        self._kept = [replace(kept, face=refocused(kept.face, ratio)) for kept in self._kept]

    def _closest(self) -> tuple[float, int]:
        """How far apart the two closest views are, and the number of the later one."""
        pairs = (
            (_apart(later.descriptor, earlier.descriptor), number)
            for number, later in enumerate(self._kept)
            for earlier in self._kept[:number]
        )
        return min(pairs)


class IdentityRefiner:
    """Improves the identity of one caller.

    origin: the caller in the first frame, with its information.  texture, first: what is fitted,
    and its view of that frame.  active: actuators that move.
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
        self._bundle = PhotometricBundleAdjustment(head, origin, first.target, active)
        self._current = replace(origin, frames=origin.frames[:1])
        self._album = KeyframeSet()
        self._seconds = 0.0
        self._due = list(SCHEDULE_S)
        self._beside = low_priority_executor(1)
        self._coming: Future[IdentityFit | None] | None = None
        self._adopted = True

    def advance(self, elapsed_s: float) -> None:
        """Another frame of the caller, so long after the one before."""
        self._seconds += elapsed_s

    def add_keyframe_candidate(self, grey: Picture, face: FaceParameters) -> None:
        """Take notice of a frame, (h, w) luma, that is explained well."""
        if self._coming is not None or not self._adopted:
            return
        place = pose_descriptor(face, self._active)
        if self._album.wants(place):
            self._album.add(Keyframe(self._texture.observe(grey, face), face, place))
        if self._due and self._seconds >= self._due[0]:
            del self._due[0]
            self._coming = self._beside.submit(
                validated_adjustment,
                self._bundle,
                self._current,
                self._first,
                self._album.keyframes,
            )
            self._ready_s = self._seconds + LATENCY_S

    def take_result(self) -> IdentityFit | None:
        """A better identity, once, with the face in the first frame; None: the one before stays.

        It is waited for a fixed number of frames after it was begun, whatever the machine's pace.
        """
        if self._coming is None or self._seconds < self._ready_s:
            return None
        better, self._coming = self._coming.result(), None
        self._adopted = better is None
        return better

    def adopt(self, fitted: IdentityFit) -> None:
        """From now on faces are those of the improved identity."""
        self._album.refocus(fitted.camera.focal_px / self._current.camera.focal_px)
        self._current, self._adopted = fitted, True


def validated_adjustment(
    bundle: PhotometricBundleAdjustment,
    current: IdentityFit,
    first: Observation,
    kept: Sequence[Keyframe],
) -> IdentityFit | None:
    """The identity that explains views better than `current`, those that check it as well."""
    checks = kept[VALIDATION_EVERY - 1 :: VALIDATION_EVERY]
    taught = [view for number, view in enumerate(kept, 1) if number % VALIDATION_EVERY]
    if not checks:
        return None

    def together(
        fitted: IdentityFit, views: Sequence[Keyframe]
    ) -> tuple[IdentityFit, list[Observation]]:
        ratio = fitted.camera.focal_px / current.camera.focal_px
        faces = (refocused(kept.face, ratio) for kept in views)
        frames = (fitted.frames[0], *faces)
        return replace(fitted, frames=frames), [first, *(kept.observation for kept in views)]

    before = bundle.resect(*together(current, checks)).residual_mse_grey2
    better = bundle.adjust(*together(current, taught)).fitted
    after = bundle.resect(*together(better, checks)).residual_mse_grey2
    if after > (1 - MIN_IMPROVEMENT) * before:
        return None
    return replace(better, frames=better.frames[:1])


def pose_descriptor(face: FaceParameters, active: Sequence[int]) -> Array:
    """(3 + a,) rotation and active actuators, in units of what is far apart."""
    turn = geometry.vector_from_quaternion(face.pose.rotation)
    return np.concatenate([turn / DISTANCE_SCALE_RAD, face.eau[list(active)] / DISTANCE_SCALE_EAU])


def _apart(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other))
