"""Faces in place of those that were lost, and the way back from them: nothing ever jumps."""

from dataclasses import dataclass, replace

import numpy as np

from decoder.playout.frame_decoder import TimedFace
from protocol.model_packet import ModelPacket
from shared_model.arrays import Array
from shared_model.geometry import (
    conjugate,
    interpolate,
    multiply,
    normalise,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import FaceParameters, Pose, clip_eau

# How long a face that is lost stays, and then takes to go to rest, seconds.
HELD_S, TO_REST_S = 0.4, 0.8
# Frames in which a wrong face returns to the true one, at least and at most.
RETURN_FRAMES, MAX_RETURN_FRAMES = 4, 25


@dataclass(frozen=True, slots=True)
class FaceChange:
    """What leads from one face to another.

    turn: (3,) axis-angle vector, radians, camera frame; shift_mm: (3,) camera frame.
    eau: (len(EAUS),); modes: (k,); layers: (l,).
    """

    turn: Array
    shift_mm: Array
    eau: Array
    modes: Array
    layers: Array

    @property
    def sizes(self) -> Array:
        """(3,) how far head, position and actuators move: radians, mm, units."""
        return np.array(
            [np.linalg.norm(self.turn), np.linalg.norm(self.shift_mm), np.abs(self.eau).max()]
        )


def change_between(first: FaceParameters, second: FaceParameters) -> FaceChange:
    """What leads from `first` to `second`; none of modes or layers if their numbers differ."""
    turn = vector_from_quaternion(multiply(second.pose.rotation, conjugate(first.pose.rotation)))
    return FaceChange(
        turn,
        second.pose.translation_mm - first.pose.translation_mm,
        second.eau - first.eau,
        _difference(first.modes, second.modes),
        _difference(first.layers, second.layers),
    )


def _difference(first: Array, second: Array) -> Array:
    return second - first if first.shape == second.shape else np.zeros(second.shape)


def changed(face: FaceParameters, change: FaceChange, share: float) -> FaceParameters:
    """`face` with `share` of a change; without that of modes or layers if their numbers differ."""
    rotation = multiply(quaternion_from_vector(share * change.turn), face.pose.rotation)
    pose = Pose(normalise(rotation), face.pose.translation_mm + share * change.shift_mm)
    return FaceParameters(
        pose,
        clip_eau(face.eau + share * change.eau),
        _added(face.modes, share * change.modes),
        _added(face.layers, share * change.layers),
    )


def _added(values: Array, change: Array) -> Array:
    return values + change if values.shape == change.shape else values


def bridge(before: TimedFace, after: TimedFace, index: int) -> tuple[FaceParameters, bool]:
    """The face of source frame `index` between two coded faces, and whether it repeats `before`.

    The way takes at most `MAX_RETURN_FRAMES`: in a longer gap the face waits before.
    """
    start = max(before.timestamp, after.timestamp - MAX_RETURN_FRAMES)
    if index <= start:
        return before.face, True
    fraction = (index - start) / (after.timestamp - start)
    return interpolate(before.face, after.face, float(fraction)), False


class SmoothReturn:
    """Leads from concealed faces back to the true ones, no faster than the face has moved before.

    shown: the face of the frame before; None: there is none.
    """

    def __init__(self) -> None:
        self.shown: FaceParameters | None = None
        self._fastest = np.zeros(3)  # as `FaceChange.sizes`, of one frame
        self._error: FaceChange | None = None
        self._frames = self._frames_left = 0
        self._is_interrupted = False

    def interrupt(self) -> None:
        """The next face is reached from the one shown last, however far away it is."""
        self._is_interrupted = self.shown is not None

    def correct(self, true_face: FaceParameters) -> None:
        """Return to the true faces; `true_face` is that of the frame before."""
        if self.shown is None:
            return
        self._error = change_between(true_face, self.shown)
        speed = np.maximum(self._fastest, 1e-9)
        needed = int(np.ceil((self._error.sizes / speed).max()))
        self._frames = self._frames_left = min(max(needed, RETURN_FRAMES), MAX_RETURN_FRAMES)

    def show(self, face: FaceParameters) -> FaceParameters:
        """The face to show next where the true one is `face`."""
        if self._is_interrupted:
            self._is_interrupted = False
            self.correct(face)
        if self._error is not None:
            self._frames_left -= 1
            face = changed(face, self._error, self._frames_left / self._frames)
            self._error = self._error if self._frames_left else None
        elif self.shown is not None:
            self._fastest = np.maximum(self._fastest, change_between(self.shown, face).sizes)
        self.shown = face
        return face


def at_rest(face: FaceParameters, model: ModelPacket, lost_s: float) -> FaceParameters:
    """The face of a head that was lost `lost_s` seconds ago: it stays, then goes to rest.

    Rest is the face of the model's reference picture.
    """
    passed = min(max((lost_s - HELD_S) / TO_REST_S, 0.0), 1.0)
    if not passed:
        return face
    coefficients = np.zeros_like(face.modes), np.zeros_like(face.layers)
    rest = replace(model.reference_face, modes=coefficients[0], layers=coefficients[1])
    return interpolate(face, rest, passed * passed * (3 - 2 * passed))
