"""The default profile of a recorded source: look at all of it, then send the best call.

First pass: landmarks of every frame.  Between: one identity for the whole call, an appearance
model learned from a sample of frames.  Second pass: every frame refined against that model,
combined, coded.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from encoder.coding.model_packet import shape_packet
from encoder.coding.transform import Sensitivity, combine, project, sensitivity
from encoder.detection.landmark_indices import EYE_CORNERS
from encoder.fitting.identity import Fitted, fit_identity
from encoder.fitting.landmark_fit import fit_frame, landmark_model, personalise, start_parameters
from encoder.learning.person_model import Caller, Learned
from protocol.frames.frame_transform import Components, serialise_components, vector_from_face
from protocol.packets import CallParameters, ModelPacket
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

IDENTITY_FRAMES = 10
TRAINING_FRAMES = 64
SENSITIVITY_FRAMES = 12
# Landmarks are smoothed over time with this kernel before the first fit.
SMOOTHING = np.array([0.06, 0.24, 0.4, 0.24, 0.06])


class Sampler:
    """Keeps `least` frames to twice as many of a source of any length."""

    def __init__(self, least: int = TRAINING_FRAMES) -> None:
        self._least, self._stride = least, 1
        self.frames: list[tuple[int, Picture]] = []

    def offer(self, number: int, window: Callable[[], Picture]) -> None:
        """Take or leave item `number`; `window` makes the picture to keep."""
        if number % self._stride:
            return
        self.frames.append((number, window()))
        if len(self.frames) >= 2 * self._least:
            self._stride *= 2
            self.frames = [f for f in self.frames if f[0] % self._stride == 0]


def follow_all(
    head: Head, size: tuple[int, int], points: Sequence[Array], near: Fitted | None = None
) -> tuple[Fitted, list[FaceParameters]]:
    """One identity, and pose and actuators of every frame, from its landmarks (468, 3).

    near: see `fit_identity`.
    """
    chosen = spread_frames(np.array(points))
    fitted = fit_identity(head, size, [points[i] for i in chosen], near=near)
    model = personalise(landmark_model(head), fitted.identity.aau, fitted.control_mm)
    current = start_parameters(model, fitted.camera, points[0])
    faces = []
    for place in points:
        current = fit_frame(model, fitted.camera, place, current)
        faces.append(current)
    return fitted, faces


def smoothed(points: Array) -> Array:
    """Landmarks (t, 468, 3) low-passed over time; the ends as they are mirrored."""
    reach = len(SMOOTHING) // 2
    if len(points) <= reach:
        return points
    padded = np.pad(points, ((reach, reach), (0, 0), (0, 0)), mode="reflect")
    return np.asarray(sum(w * padded[i : i + len(points)] for i, w in enumerate(SMOOTHING)))


def spread_frames(points: Array) -> list[int]:
    """Indices of up to `IDENTITY_FRAMES` frames, spread over yaw and pitch."""
    eyes = points[:, list(EYE_CORNERS)].mean(1)
    turn = points[:, 1, :2] - eyes[:, :2]
    shares = np.linspace(0.02, 0.98, IDENTITY_FRAMES // 2)
    picks = [np.argsort(turn[:, axis])[(shares * (len(points) - 1)).astype(int)] for axis in (0, 1)]
    return sorted(set(np.concatenate(picks).tolist()))


def combine_call(
    learned: Learned, faces: Sequence[FaceParameters], frames_per_packet: int
) -> tuple[Components, Array]:
    """The call's components, and their values (t, n) in every frame."""
    caller = learned.caller
    pose = caller.reference.pose
    harm = sensitivity_of(learned).harm(caller.tracker.template.modes)
    vectors = np.array([vector_from_face(face, pose) for face in faces])
    components = combine(vectors, harm, caller.appearance.modes, frames_per_packet)
    return components, project(components, vectors, harm)


def sensitivity_of(learned: Learned) -> Sensitivity:
    """What errors do to this caller's picture, by a few of the frames it was learned from."""
    caller = learned.caller
    every = slice(None, None, max(1, len(learned.crops) // SENSITIVITY_FRAMES))
    pose = caller.reference.pose
    return sensitivity(caller.tracker, learned.crops[every], learned.faces[every], pose)


def default_model(
    caller: Caller, components: Components, call: CallParameters, background: bytes
) -> ModelPacket:
    """The model packet of the default profile.  background: the coded still."""
    return replace(
        shape_packet(caller.fitted, caller.reference, call),
        background=background,
        texture=caller.appearance.texture,
        extension=serialise_components(components),
    )
