"""The models of a live call: what is learned of the caller, ready to send frames under."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.capture.face_crop import crop_face
from encoder.capture.video_source import Capture
from encoder.coding.background import Still
from encoder.coding.gop import Cadence
from encoder.coding.model_packet import BUDGETS, Budget, call_parameters
from encoder.coding.motion_prior import expected_components
from encoder.coding.progressive_model import FIRST_LAYER_BYTES, LayeredModel, layered
from encoder.coding.transform import Sensitivity, project
from encoder.detection.landmark_indices import outline_of
from encoder.fitting.eyelids import between_lids, fit_with_lids
from encoder.fitting.identity import Fitted
from encoder.fitting.landmark_fit import (
    LandmarkModel,
    landmark_model,
    personalise,
    start_parameters,
)
from encoder.fitting.render_and_compare import Drawing, drawing_of
from encoder.learning.incremental_modes import Grown, Look
from encoder.learning.person_model import Caller, Learned, learn_caller
from encoder.learning.two_pass import (
    default_model,
    follow_all,
    sensitivity_of,
)
from protocol.frames.frame_transform import (
    MAX_MODES,
    Components,
    serialise_components,
    vector_from_face,
    with_spare,
)
from protocol.packets import SEQUENCE_MODULUS, CallParameters, ModelPacket
from protocol.pictures.picture_codec import ModeSeries, decode_still
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# Modes that may be learned between one model packet and the next.
SPARE_MODES = MAX_MODES - BUDGETS["live"].most_modes
# Pixels that a frame is fitted by: twice as many gained nothing on two live clips.
DRAWN_PIXELS = 3000
# Harm of the lids' errors, see `Sensitivity.harm`, more than in a recorded call: until closed lids
# are learned a blink is in the actuators alone, and the coarse steps of a live call's beginning
# would lose it.  It counts less how far the lids differ: people shut both.
LID_HARM = 500.0 * np.array([[1.0, 0.8], [0.8, 1.0]])


@dataclass(frozen=True, slots=True)
class Epoch:
    """A model packet, and what is needed to send frames under it.

    components: those in use, spare ones once their modes are learned.
    harm: of these, see `Sensitivity.harm`.
    drawing: of what has been sent, or is on its way.
    number: of its first frame packet in the call.
    """

    model: ModelPacket
    learned: Learned
    landmarks: LandmarkModel
    components: Components
    sensitivity: Sensitivity
    harm: Array
    drawing: Drawing
    number: int = 0

    @property
    def room(self) -> int:
        """How many modes may yet be learned."""
        return SPARE_MODES - self.components.spare

    @property
    def all_components(self) -> Components:
        """Components as the model packet has them, all spare ones too."""
        return with_spare(self.components, self.room)

    def at(self, number: int, start: int) -> "Epoch":
        """The same from frame packet `number` on, whose first source frame is `start`."""
        call = replace(self.model.call, start_frame=start)
        model = replace(self.model, call=call, sequence=number % SEQUENCE_MODULUS)
        return replace(self, model=model, number=number)

    def look(self, frame: Picture, points: Array) -> Look:
        """A frame and its landmarks (468, 3), pixels, as the face is found in."""
        return Look(crop_face(frame, points, self.learned.caller.pixels_per_texel), points)

    def find(self, look: Look, near: FaceParameters | None = None) -> FaceParameters:
        """The caller in a look as they draw best.  near: see `explain`."""
        return self.drawing.fit(look.crop, self.explain(look, near), outline_of(look.points))

    def explain(self, look: Look, near: FaceParameters | None = None) -> FaceParameters:
        """The caller in a look, by landmarks, then by the learned appearance.

        near: the face before, if known.
        """
        camera = self.model.call.camera
        start = near or start_parameters(self.landmarks, camera, look.points)
        seen = fit_with_lids(self.landmarks, camera, look.points, start)
        return between_lids(seen, self.learned.caller.tracker.refine(look.crop, seen, 3))

    def redrawn(self, look: Look, face: FaceParameters) -> FaceParameters:
        """A face that was found in a look before the newest modes, with these."""
        modes = _padded(face.modes, len(self.components.modes))
        return self.drawing.fit(look.crop, replace(face, modes=modes), outline_of(look.points))

    def values(self, faces: Sequence[FaceParameters]) -> Array:
        """(t, n) of all components in some frames; modes newer than a face it has none of."""
        pose = self.model.reference_pose
        vectors = [_padded(vector_from_face(face, pose), len(self.harm)) for face in faces]
        values = project(self.components, np.array(vectors), self.harm)
        return np.pad(values, ((0, 0), (0, self.room)))

    def grown(self, mode: Grown) -> "Epoch":
        """The same with a mode more; teaches it the caller's tracker.

        This one can `find` no more: the tracker knows a mode that its drawing does not.
        """
        tracker, atlas = self.learned.caller.tracker, self.learned.caller.shape.atlas
        tracker.teach(mode.luma[atlas.rows, atlas.columns])
        return replace(
            self,
            components=with_spare(self.components, 1),
            harm=self.sensitivity.harm(tracker.template.modes, LID_HARM),
            drawing=self.drawing.taught(mode.luma),
        )


class Learner:
    """Learns one caller again and again, from ever more frames of a live call.

    still: what the background shows.  workers: see `encoder.runtime.parallel.on_cores`.
    """

    def __init__(
        self,
        head: Head,
        capture: Capture,
        cadence: Cadence,
        still: Still,
        background_bytes: int,
        workers: int | None,
    ) -> None:
        self._head, self._capture, self._cadence = head, capture, cadence
        self._still, self._workers = still, workers
        self._fitted: Fitted | None = None
        # Coded beside the first model's learning: both take as long as many frames.
        beside = ThreadPoolExecutor(1)
        self._background = beside.submit(still.coded, background_bytes)
        beside.shutdown(wait=False)

    def learn(
        self, budget: Budget, pictures: Sequence[Picture], points: Sequence[Array], layer: int
    ) -> Epoch:
        """Model number `layer` from some frames and their landmarks (468, 3), yet to be placed.

        With a budget of no bytes for the background it has none: that before stays.
        """
        learned = self._learned(budget, pictures, points)
        caller = learned.caller
        pose = caller.reference.pose
        sensitivity = sensitivity_of(learned)
        harm = sensitivity.harm(caller.tracker.template.modes, LID_HARM)
        vectors = np.array([vector_from_face(face, pose) for face in learned.faces])
        cadence, modes = self._cadence, caller.appearance.modes
        components = expected_components(
            vectors,
            harm,
            modes,
            frames_per_packet=cadence.frames_per_packet,
            frame_step=cadence.frame_step,
        )
        call = self._call_parameters(caller.fitted.camera.focal_px)
        background = self._background.result() if budget.background_bytes else b""
        packet = default_model(caller, components, call, background)
        roomy = serialise_components(with_spare(components, SPARE_MODES))
        model = replace(packet, layer=layer, layers=layer + 1, extension=roomy, growing=True)
        landmarks = self._landmarks(caller.fitted)
        drawing = _drawing(caller)
        return Epoch(model, learned, landmarks, components, sensitivity, harm, drawing)

    def in_layers(
        self, epoch: Epoch, first_bytes: int = FIRST_LAYER_BYTES
    ) -> tuple[Epoch, LayeredModel]:
        """The epoch with only the first layer of its model, and all of them.

        first_bytes: see `layered`.
        """
        mean = epoch.learned.caller.appearance.mean
        parts = layered(epoch.model, mean, self._still, first_bytes)
        return replace(epoch, model=parts.first), parts

    def rough(self, epoch: Epoch) -> Epoch:
        """The epoch with only the first layer of its model, and nothing to follow."""
        epoch, parts = self.in_layers(epoch)
        learned, texture = epoch.learned, parts.first.texture
        mean = decode_still("texture", texture)
        appearance = replace(
            learned.caller.appearance,
            texture=texture,
            mean=mean,
            series=ModeSeries(len(mean)),
        )
        caller = replace(learned.caller, appearance=appearance)
        learned = replace(learned, caller=caller)
        return replace(epoch, learned=learned, drawing=_drawing(caller))

    def _learned(
        self, budget: Budget, pictures: Sequence[Picture], points: Sequence[Array]
    ) -> Learned:
        size = (self._capture.width, self._capture.height)
        fitted, faces = follow_all(self._head, size, points, self._fitted)
        self._fitted = fitted
        # Lids as frames will have them.
        landmarks = self._landmarks(fitted)
        faces = [
            fit_with_lids(landmarks, fitted.camera, place, face)
            for place, face in zip(points, faces, strict=True)
        ]
        call = self._call_parameters(fitted.camera.focal_px)
        frames = list(enumerate(pictures))
        return learn_caller(
            self._head,
            fitted,
            faces,
            frames,
            points,
            call,
            budget,
            self._workers,
            live=True,
        )

    def _landmarks(self, fitted: Fitted) -> LandmarkModel:
        return personalise(landmark_model(self._head), fitted.identity.aau, fitted.control_mm)

    def _call_parameters(self, focal_px: float) -> CallParameters:
        packing = self._cadence.frames_per_packet, self._cadence.frame_step
        return call_parameters(self._capture, "default", focal_px, 0, *packing)


def _padded(values: Array, count: int) -> Array:
    """Values, and zeros up to so many."""
    return np.append(values, np.zeros(count - len(values)))


def _drawing(caller: Caller) -> Drawing:
    """What a decoder draws of a live caller, before single modes."""
    return drawing_of(caller.face, caller.shape.camera, caller.appearance, DRAWN_PIXELS)
