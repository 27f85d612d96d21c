"""The models of a live call: what is learned of the caller, ready to send frames under."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.cadence import Cadence
from encoder.capture import Capture
from encoder.combine import combine, harm_matrix
from encoder.fit import LandmarkModel, landmark_model, personalise
from encoder.imagine import imagined
from encoder.model import Budget, call_parameters
from encoder.startup import FIRST_LAYER_BYTES, LayeredModel, layered
from encoder.texture import code_background
from encoder.two_pass import Learned, default_model, follow_all, learn_caller
from protocol.components import Components, vector_from_face
from protocol.messages import SEQUENCE_MODULUS, CallParameters, ModelPacket
from shared_model.mesh import Head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Epoch:
    """A model packet, and what is needed to send frames under it.

    number: of its first frame packet in the call.
    """

    model: ModelPacket
    learned: Learned
    landmarks: LandmarkModel
    components: Components
    harm: Array
    number: int = 0

    def at(self, number: int, start: int) -> "Epoch":
        """The same from frame packet `number` on, whose first source frame is `start`."""
        call = replace(self.model.call, start_frame=start)
        model = replace(self.model, call=call, sequence=number % SEQUENCE_MODULUS)
        return replace(self, model=model, number=number)


class Learner:
    """Learns one caller again and again, from ever more frames of a live call.

    still: (h, w, 3) BGR, what the background shows.  workers: see `encoder.parallel.on_cores`.
    """

    def __init__(
        self,
        head: Head,
        capture: Capture,
        cadence: Cadence,
        still: Picture,
        background_bytes: int,
        workers: int | None,
    ) -> None:
        self._head, self._capture, self._cadence = head, capture, cadence
        self._still, self._workers = still, workers
        self._background = code_background(still, background_bytes)

    def learn(
        self, budget: Budget, pictures: Sequence[Picture], points: Sequence[Array], layer: int
    ) -> Epoch:
        """Model number `layer` from some frames and their landmarks (468, 3), yet to be placed."""
        learned = self._learned(budget, pictures, points)
        caller = learned.caller
        pose = caller.reference.pose
        every = max(1, len(learned.crops) // 12)
        harm = harm_matrix(caller.tracker, learned.crops[::every], learned.faces[::every], pose)
        vectors = np.array([vector_from_face(face, pose) for face in learned.faces])
        cadence, modes = self._cadence, caller.appearance.modes
        motion = imagined(vectors, cadence.frame_step)
        components = combine(motion, harm, modes, cadence.frames_per_packet)
        call = self._call_parameters(caller.fitted.camera.focal_px)
        packet = default_model(caller, components, call, self._background)
        model = replace(packet, layer=layer, layers=layer + 1)
        landmarks = personalise(
            landmark_model(self._head), caller.fitted.identity.aau, caller.fitted.control_mm
        )
        return Epoch(model, learned, landmarks, components, harm)

    def in_layers(
        self, epoch: Epoch, first_bytes: int = FIRST_LAYER_BYTES
    ) -> tuple[Epoch, LayeredModel]:
        """The epoch with only the first layer of its model, and all of them.

        first_bytes: see `layered`.
        """
        mean = epoch.learned.caller.appearance.mean
        parts = layered(epoch.model, mean, self._still, first_bytes)
        return replace(epoch, model=parts.first), parts

    def _learned(
        self, budget: Budget, pictures: Sequence[Picture], points: Sequence[Array]
    ) -> Learned:
        size = (self._capture.width, self._capture.height)
        fitted, faces = follow_all(self._head, size, points)
        call = self._call_parameters(fitted.camera.focal_px)
        frames = list(enumerate(pictures))
        return learn_caller(self._head, fitted, faces, frames, points, call, budget, self._workers)

    def _call_parameters(self, focal_px: float) -> CallParameters:
        packing = self._cadence.frames_per_packet, self._cadence.frame_step
        return call_parameters(self._capture, "default", focal_px, 0, *packing)
