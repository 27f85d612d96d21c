"""The faces of a call on their way to pages that draw them."""

import time
from collections import deque
from collections.abc import Callable

from decoder.playout.playout import PlayoutFrame
from protocol.model_packet import ModelPacket
from protocol.packets import serialise
from risorius.call_page.face_message import face_values
from risorius.live_call.messages import ShownFace, ShownModel
from risorius.live_call.thinning import frame_step

# Models whose faces may still come: in use and to come, with more and fewer layers.
KEPT_MODELS = 8


class ShownFaces:
    """A `FaceObserver` that sends on what it sees.

    fps: faces a second that are wanted, about; None: all.
    """

    def __init__(self, send: Callable[[ShownModel | ShownFace], None], fps: float | None) -> None:
        self._send, self._fps = send, fps
        self._is_drawn_here = False
        self._models = deque[tuple[int, ModelPacket]](maxlen=KEPT_MODELS)  # with their numbers
        self._count = 0

    @property
    def wants_pictures(self) -> bool:
        """See `FaceObserver`; pages do not draw a picture residual."""
        model = self._models[-1][1] if self._models else None
        return self._is_drawn_here or (model is not None and model.call.has_residual)

    def draw_here(self, is_drawn: bool) -> None:
        """Draw pictures besides, or not any more."""
        self._is_drawn_here = is_drawn

    def see_model(self, model: ModelPacket) -> None:
        """See `FaceObserver`."""
        self._number_of(model)

    def see_frame(self, frame: PlayoutFrame, arrival_s: float) -> None:
        """See `FaceObserver`."""
        if frame.index % frame_step(frame.model.call.fps, self._fps):
            return
        number, waited_s = self._number_of(frame.model), time.monotonic() - arrival_s
        when = frame.index, float(frame.time_s), 1000 * time.time(), round(1000 * waited_s)
        state = frame.frozen, frame.lost, number, frame.presence
        self._send(ShownFace(*when, *state, face_values(frame.face)))

    def _number_of(self, model: ModelPacket) -> int:
        """The number of a model, which is sent if it is new."""
        for number, known in self._models:
            if known is model:
                return number
        self._count += 1
        self._models.append((self._count, model))
        self._send(ShownModel(self._count, serialise(model)))
        return self._count
