"""The models whose faces pages draw: each is sent once, and its faces name it by a number."""

from collections import deque
from collections.abc import Callable

from protocol.model_packet import ModelPacket
from protocol.packets import serialise

# Models whose faces may still come: in use and to come, with more and fewer layers.
KEPT_MODELS = 8


class NumberedModels:
    """Numbers models.  send: called with the number and the packet of each that is new."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        self._send = send
        self._models = deque[tuple[int, ModelPacket]](maxlen=KEPT_MODELS)
        self._count = 0

    @property
    def newest(self) -> ModelPacket | None:
        """The model that came last."""
        return self._models[-1][1] if self._models else None

    def number_of(self, model: ModelPacket) -> int:
        """The number of a model, which is sent if it is new."""
        for number, known in self._models:
            if known is model:
                return number
        self._count += 1
        self._models.append((self._count, model))
        self._send(self._count, serialise(model))
        return self._count
