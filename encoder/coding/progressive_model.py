"""A paced start on a thin link: the model in layers, between frame packets that flow at once."""

from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from encoder.coding.background import Still
from encoder.picture_coding.image_budget import finest_still
from protocol.frames.frame_transform import parse_components, serialise_components
from protocol.packets import MAX_LAYER_BYTES, LayerPacket, ModelPacket, serialise
from protocol.pictures.probability_model import TEXTURE
from protocol.progressive_model import item

# A first layer is no larger, and spends this much of what shape and tables leave on the texture.
# That of an update comes when all its other layers are there: nobody sees its pictures.
FIRST_LAYER_BYTES, UPDATE_LAYER_BYTES = 2000, 1200
TEXTURE_SHARE = 0.5
# Byte 0 of a packet and the length before it in a call file, mostly.
OVERHEAD_BYTES = 2
# What a layer packet adds to its data: the length before it in a call file, byte 0, its number.
LAYER_OVERHEAD_BYTES = OVERHEAD_BYTES + 3
# Pieces of an item are no smaller: their overhead would show.
LEAST_PIECE_BYTES = 64


@dataclass(frozen=True, slots=True)
class LayeredModel:
    """A model as it is sent in layers.

    first: its first layer.  items: what comes after it, as `protocol.progressive_model` has them.
    """

    first: ModelPacket
    items: tuple[bytes, ...]


def layered(
    model: ModelPacket,
    mean: NDArray[Any],
    still: Still,
    first_bytes: int = FIRST_LAYER_BYTES,
) -> LayeredModel:
    """A model of the default profile in layers.

    mean: (n, n, 3) BGR 0..255, its texture.  still: what its background shows.
    first_bytes: of the first layer; it is larger if shape and tables alone are.
    """
    components = parse_components(model.extension)
    blank = replace(components, modes=(b"",) * len(components.modes))
    extension = serialise_components(blank)
    draft = replace(model, texture=b"", background=b"", extension=extension, layered=True)
    # Byte strings beyond 255 have one more byte of length than empty ones.
    left = max(0, first_bytes - len(serialise(draft)) - 2)
    texture = _rough(model.texture, finest_still(mean, int(TEXTURE_SHARE * left), kind=TEXTURE)[0])
    background = _rough(model.background, still.coded(left - len(texture)))
    first = replace(draft, texture=texture, background=background)
    pictures = ((model.texture, texture), (model.background, background))
    # An empty item leaves what the first layer has.
    whole = [b"" if rough == picture else picture for picture, rough in pictures]
    sent = components.modes[: len(components.modes) - components.spare]
    return LayeredModel(first, (*whole, *sent))


def _rough(whole: bytes, rough: bytes) -> bytes:
    return whole if len(whole) <= len(rough) else rough


class LayerPacer:
    """Says which layer packets are due, so that all packets together keep to a rate.

    bitrate: bits per second.  What has to go at once, as a first layer, is a debt; what is not
    spent lapses, so that no second makes up for another.
    frames_bitrate: bits per second of the frames alone.
    Raises `ValueError` if they leave nothing for the layers.
    """

    def __init__(self, bitrate: float, frames_bitrate: float = 0.0) -> None:
        if not bitrate > frames_bitrate:
            raise ValueError(
                f"startup bitrate is {bitrate:g}, expected more than the frames' {frames_bitrate:g}"
            )
        self._bitrate, self._credit = bitrate, 0.0
        self._model, self._number, self._items, self._learned = 0, 0, 0, 0
        self._waiting: list[bytes] = []

    @property
    def items_waiting(self) -> int:
        """Pictures and modes that the model began with and that are not yet sent whole."""
        return max(0, len(self._waiting) - self._learned)

    @property
    def items_sent(self) -> int:
        """Pictures and modes of the model that are sent whole."""
        return self._items - len(self._waiting)

    @property
    def busy(self) -> bool:
        """Whether there are layers to send, or a debt to pay."""
        return bool(self._waiting) or self._credit < 0

    def begin(self, model: LayeredModel) -> None:
        """Send this model's layers from now on, instead of any before."""
        self._model, self._number = model.first.layer, 0
        self._items, self._learned = len(model.items), 0
        self._waiting = [item(data) for data in model.items]

    def add(self, data: bytes) -> None:
        """Send one more mode of the same model."""
        self._items += 1
        self._learned += 1
        self._waiting.append(item(data))

    def carried_s(self, packet_bytes: int) -> float:
        """How long a packet of this size takes at the rate."""
        return 8 * packet_bytes / self._bitrate

    def spent(self, packet_bytes: int) -> None:
        """A packet of this size has been sent."""
        self._credit -= 8 * (packet_bytes + OVERHEAD_BYTES - 1)

    def due(self, seconds: float) -> list[LayerPacket]:
        """The packets to send now.  seconds: since this was last asked."""
        earned = self._bitrate * seconds
        kept = max(earned, 8 * (LEAST_PIECE_BYTES + LAYER_OVERHEAD_BYTES))
        self._credit = min(self._credit + earned, kept)
        packets = list[LayerPacket]()
        while self._waiting:
            room = int(self._credit / 8) - LAYER_OVERHEAD_BYTES
            data = self._waiting[0][: min(max(room, 0), MAX_LAYER_BYTES)]
            if len(data) < min(LEAST_PIECE_BYTES, len(self._waiting[0])):
                break
            packets.append(LayerPacket(self._model, self._number, data))
            self._number += 1
            self._credit -= 8 * (len(data) + LAYER_OVERHEAD_BYTES)
            self._waiting[0] = self._waiting[0][len(data) :]
            if not self._waiting[0]:
                self._waiting.pop(0)
        return packets
