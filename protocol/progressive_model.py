"""What a first layer of a model leaves out, sent bit by bit while frames already flow.

The rest of a layered model is one stream of bytes: the texture, the background, then each
appearance mode in order, every item after its length.  Layer packets are consecutive pieces of it,
cut anywhere.  Whatever part of the stream has come, in whatever order, makes a model that can be
drawn: a whole picture replaces the rough one of the first layer, an empty one leaves it, and modes
that have not come yet add nothing.

A live call goes on with spare modes, as it learns them; of a model that was sent whole the stream
has two empty pictures and nothing but these.
"""

from collections.abc import Iterator
from dataclasses import replace

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import MAX_MODES, parse_transform, serialise_transform
from protocol.limits import MAX_IMAGE_BYTES, MAX_MODEL_PACKET_BYTES
from protocol.model_packet import ModelPacket
from protocol.packets import LayerPacket

PICTURE_ITEMS = ("texture", "background")
MAX_ITEMS = len(PICTURE_ITEMS) + MAX_MODES
# A length is at most this long; longer ones are out of bounds.
LENGTH_BYTES = 3


def stream_item(data: bytes) -> bytes:
    """One picture or mode as it stands in the stream."""
    return encode_varint(len(data)) + data


class LayerBuffer:
    """The layer packets of a call, in any order of arrival, by the model that they refine.

    Keeps no more than `limit_bytes`; every packet counts as `COST_BYTES` beside its data.
    """

    COST_BYTES = 64

    def __init__(self, limit_bytes: int = 2 * MAX_MODEL_PACKET_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._pieces: dict[int, dict[int, bytes]] = {}
        self._bytes = 0

    def add(self, packet: LayerPacket) -> None:
        """Take in a packet; one that is there already changes nothing.

        Raises `ProtocolError` if there are more than can be kept.
        """
        pieces = self._pieces.setdefault(packet.model_version, {})
        cost = len(packet.data) + self.COST_BYTES
        if packet.number in pieces:
            return
        if self._bytes + cost > self._limit_bytes:
            raise ProtocolError(f"layer packets of more than {self._limit_bytes} bytes")
        pieces[packet.number] = packet.data
        self._bytes += cost

    def drop_before(self, model: int) -> None:
        """Let go of what refines models older than number `model`."""
        for number in [number for number in self._pieces if number < model]:
            gone = self._pieces.pop(number).values()
            self._bytes -= sum(len(data) + self.COST_BYTES for data in gone)

    def apply(self, model: ModelPacket) -> ModelPacket:
        """`model` with all that has come without a gap; itself if that is nothing new.

        Raises `ProtocolError` if the stream is none or too large, or `model` is not in layers.
        """
        found = [data for _, data, whole in self._items(model.version) if whole]
        if not found:
            return model
        components = parse_transform(model.profile_data) if model.profile_data else None
        if components is None or not (model.progressive or components.reserved_modes):
            raise ProtocolError(f"layer packets for model {model.version}, which has no layers")
        # What came whole, in the model packet.
        known = () if model.progressive else components.modes[: -components.reserved_modes]
        modes, room = tuple(found[len(PICTURE_ITEMS) :]), len(components.modes) - len(known)
        if len(modes) > room or not all(modes):
            raise ProtocolError(f"{len(modes)} modes in layers, expected {room}")
        texture, background = [*found, b""][: len(PICTURE_ITEMS)]
        if not model.progressive and (texture or background):
            raise ProtocolError(f"pictures in layers for model {model.version}, which has its own")
        missing = (b"",) * (room - len(modes))
        extension = serialise_transform(replace(components, modes=known + modes + missing))
        try:
            refined = replace(
                model,
                texture=texture or model.texture,
                background=background or model.background,
                profile_data=extension,
            )
        except ValueError as error:
            raise ProtocolError(f"layers of model {model.version}: {error}") from error
        return model if refined == model else refined

    def bytes_by_item(self, model: int) -> dict[str, int]:
        """Bytes of texture, background and modes that have come without a gap."""
        parts: dict[str, int] = {}
        for name, data, _ in self._items(model):
            parts[name] = parts.get(name, 0) + len(data)
        return parts

    def _items(self, model: int) -> Iterator[tuple[str, bytes, bool]]:
        """What each item is of, what has come of it, and whether that is all."""
        stream, place, count = self._stream(model), 0, 0
        while place < len(stream):
            if count == MAX_ITEMS:
                raise ProtocolError(f"more than {MAX_ITEMS} items in layers")
            try:
                length, used = decode_varint(stream[place : place + LENGTH_BYTES])
            except ValueError as error:
                if len(stream) - place < LENGTH_BYTES:
                    return
                raise ProtocolError(f"item {count} of the layers: {error}") from error
            if length > MAX_IMAGE_BYTES:
                raise ProtocolError(f"item {count} of the layers has {length} bytes")
            start, place = place + used, place + used + length
            name = PICTURE_ITEMS[count] if count < len(PICTURE_ITEMS) else "modes"
            yield name, stream[start:place], place <= len(stream)
            count += 1

    def _stream(self, model: int) -> bytes:
        pieces = self._pieces.get(model, {})
        found: list[bytes] = []
        while (data := pieces.get(len(found))) is not None:
            found.append(data)
        return b"".join(found)


def is_same_model(model: ModelPacket, other: ModelPacket) -> bool:
    """Whether both are the same model, perhaps with more or fewer of its layers.

    A background may not have come yet to who joined at an update without one.
    """
    refined = replace(model, profile_data=other.profile_data)
    if model.progressive or not (model.background and other.background):
        refined = replace(refined, background=other.background)
    if model.progressive:
        refined = replace(refined, texture=other.texture)
    return other == refined
