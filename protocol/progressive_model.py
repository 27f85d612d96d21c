"""Progressive transmission of a model: what the model packet leaves out follows in layer packets.

The rest of a progressive model is one stream of bytes: the texture, the background, then each
appearance mode in order, every item after its length (varint).  Layer packets carry consecutive
pieces of the stream, cut at any byte.  The items that have been received without a gap complete the
model: a picture replaces the one of lower quality in the model packet, an empty one leaves it, and
modes that have not been received add nothing.

A live call sends its reserved modes in the same way.  The stream of a model packet that is whole
has two empty pictures and these modes.
"""

from collections.abc import Iterator
from dataclasses import replace

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import MAX_MODES
from protocol.frames.transform_coding import parse_transform, serialise_transform
from protocol.limits import MAX_IMAGE_BYTES, MAX_MODEL_PACKET_BYTES
from protocol.model_packet import ModelPacket
from protocol.packets import LayerPacket

PICTURE_ITEMS = ("texture", "background")
MAX_ITEMS = len(PICTURE_ITEMS) + MAX_MODES
# Bytes of a length, at most: lengths in bounds take no more.
LENGTH_BYTES = 3


def stream_item(data: bytes) -> bytes:
    """A picture or a mode as an item of the stream."""
    return encode_varint(len(data)) + data


class LayerBuffer:
    """The layer packets of a call, received in any order, by the model version they belong to.

    limit_bytes: of data, with `OVERHEAD_BYTES` for each packet.
    """

    OVERHEAD_BYTES = 64

    def __init__(self, limit_bytes: int = 2 * MAX_MODEL_PACKET_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._pieces: dict[int, dict[int, bytes]] = {}
        self._bytes = 0

    def add(self, packet: LayerPacket) -> None:
        """Add a packet, unless one of its number has been added before.

        Raises `ProtocolError` if the buffer would exceed its limit.
        """
        pieces = self._pieces.setdefault(packet.model_version, {})
        cost = len(packet.data) + self.OVERHEAD_BYTES
        if packet.number in pieces:
            return
        if self._bytes + cost > self._limit_bytes:
            raise ProtocolError(f"layer packets of more than {self._limit_bytes} bytes")
        pieces[packet.number] = packet.data
        self._bytes += cost

    def drop_before(self, model_version: int) -> None:
        """Remove the packets of versions before `model_version`."""
        for version in [version for version in self._pieces if version < model_version]:
            dropped = self._pieces.pop(version).values()
            self._bytes -= sum(len(data) + self.OVERHEAD_BYTES for data in dropped)

    def apply(self, model: ModelPacket) -> ModelPacket:
        """`model` with all items received without a gap; `model` itself if they change nothing.

        Raises `ProtocolError` if the stream is damaged or too large, or if `model` is neither
        progressive nor extensible.
        """
        items = [data for _, data, whole in self._items(model.version) if whole]
        if not items:
            return model
        transform = parse_transform(model.profile_data) if model.profile_data else None
        if transform is None or not (model.progressive or transform.reserved_modes):
            raise ProtocolError(f"layer packets for model {model.version}, which has no layers")
        # The modes of the model packet itself.
        known = () if model.progressive else transform.modes[: -transform.reserved_modes]
        modes, capacity = tuple(items[len(PICTURE_ITEMS) :]), len(transform.modes) - len(known)
        if len(modes) > capacity or not all(modes):
            raise ProtocolError(f"{len(modes)} modes in layers, expected {capacity}")
        texture, background = [*items, b""][: len(PICTURE_ITEMS)]
        if not model.progressive and (texture or background):
            raise ProtocolError(f"pictures in layers for model {model.version}, which has its own")
        missing = (b"",) * (capacity - len(modes))
        try:
            completed = replace(
                model,
                texture=texture or model.texture,
                background=background or model.background,
                profile_data=serialise_transform(replace(transform, modes=known + modes + missing)),
            )
        except ValueError as error:
            raise ProtocolError(f"layers of model {model.version}: {error}") from error
        return model if completed == model else completed

    def bytes_by_item(self, model_version: int) -> dict[str, int]:
        """Bytes of texture, background and modes received without a gap."""
        sizes: dict[str, int] = {}
        for name, data, _ in self._items(model_version):
            sizes[name] = sizes.get(name, 0) + len(data)
        return sizes

    def _items(self, model_version: int) -> Iterator[tuple[str, bytes, bool]]:
        """Each item's name, the bytes received of it, and whether it is complete."""
        stream, position, count = self._stream(model_version), 0, 0
        while position < len(stream):
            if count == MAX_ITEMS:
                raise ProtocolError(f"more than {MAX_ITEMS} items in layers")
            try:
                length, used = decode_varint(stream[position : position + LENGTH_BYTES])
            except ValueError as error:
                if len(stream) - position < LENGTH_BYTES:
                    return
                raise ProtocolError(f"item {count} of the layers: {error}") from error
            if length > MAX_IMAGE_BYTES:
                raise ProtocolError(f"item {count} of the layers has {length} bytes")
            start, position = position + used, position + used + length
            name = PICTURE_ITEMS[count] if count < len(PICTURE_ITEMS) else "modes"
            yield name, stream[start:position], position <= len(stream)
            count += 1

    def _stream(self, model_version: int) -> bytes:
        """The pieces received without a gap."""
        pieces = self._pieces.get(model_version, {})
        consecutive: list[bytes] = []
        while (data := pieces.get(len(consecutive))) is not None:
            consecutive.append(data)
        return b"".join(consecutive)


def is_same_model(model: ModelPacket, other: ModelPacket) -> bool:
    """Whether both are the same model, with more or fewer of its layers applied.

    A receiver that joins at an update without a background may have received none yet.
    """
    aligned = replace(model, profile_data=other.profile_data)
    if model.progressive or not (model.background and other.background):
        aligned = replace(aligned, background=other.background)
    if model.progressive:
        aligned = replace(aligned, texture=other.texture)
    return other == aligned
