"""The faces of a call on their way to pages that draw them."""

import time
from collections.abc import Callable

from decoder.playout.playout import PlayoutFrame
from protocol.model_packet import ModelPacket
from risorius.call_page.face_message import face_values
from risorius.call_page.numbered_models import NumberedModels
from risorius.live_call.messages import ShownFace, ShownModel
from risorius.live_call.thinning import frame_step


class ShownFaces:
    """A `FaceObserver` that sends on what it sees.

    fps: faces a second that are wanted, about; None: all.
    """

    def __init__(self, send: Callable[[ShownModel | ShownFace], None], fps: float | None) -> None:
        self._send, self._fps = send, fps
        self._is_drawn_here = False
        self._models = NumberedModels(lambda number, packet: send(ShownModel(number, packet)))

    @property
    def wants_pictures(self) -> bool:
        """See `FaceObserver`; pages do not draw a picture residual."""
        model = self._models.newest
        return self._is_drawn_here or (model is not None and model.call.has_residual)

    def draw_here(self, is_drawn: bool) -> None:
        """Draw pictures besides, or not any more."""
        self._is_drawn_here = is_drawn

    def see_model(self, model: ModelPacket) -> None:
        """See `FaceObserver`."""
        self._models.number_of(model)

    def see_frame(self, frame: PlayoutFrame, arrival_s: float) -> None:
        """See `FaceObserver`."""
        if frame.index % frame_step(frame.model.call.fps, self._fps):
            return
        number, waited_s = self._models.number_of(frame.model), time.monotonic() - arrival_s
        when = frame.index, float(frame.time_s), 1000 * time.time(), round(1000 * waited_s)
        state = frame.frozen, frame.lost, number, frame.presence
        self._send(ShownFace(*when, *state, face_values(frame.face)))
