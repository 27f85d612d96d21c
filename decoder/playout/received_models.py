"""The model that a call's frames are decoded by, the update that follows it, and their layers."""

from dataclasses import dataclass, replace

from decoder.playout.frame_decoder import FrameDecoder, frame_decoder_for
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.model_packet import ModelPacket
from protocol.packets import LayerPacket
from protocol.progressive_model import LayerBuffer


@dataclass(frozen=True, slots=True)
class ReceivedModel:
    """A model packet with its layers, and what decodes its frame packets.

    first: number in the call of its first frame packet.
    """

    model: ModelPacket
    decoder: FrameDecoder
    first: int

    def number_at(self, frame: int) -> int:
        """Number of the packet of the first coded face at or after source frame `frame`."""
        return self.first + self.decoder.packet_index_at(frame)


class ReceivedModels:
    """The models of one encoder.

    current: the version in use, None before a model packet.
    update: the version that is activated by the frame packet with its number; None: there is none.
    """

    def __init__(self) -> None:
        self.current: ReceivedModel | None = None
        self.update: ReceivedModel | None = None
        self._layers = LayerBuffer()
        self._completed: tuple[tuple[ModelPacket, ModelPacket], ModelPacket] | None = None

    @property
    def next_model(self) -> ModelPacket | None:
        """The model of the update with the pictures that it takes over; the same object each time.

        None: there is no update.
        """
        if self.current is None or self.update is None:
            return None
        made_of = self.current.model, self.update.model
        known = self._completed
        if known is None or any(a is not b for a, b in zip(known[0], made_of, strict=True)):
            known = made_of, _with_pictures(self.update, made_of[0]).model
            self._completed = known
        return known[1]

    def receive_model(self, packet: ModelPacket, first: int) -> None:
        """Enter the first model packet or an update; either may be repeated for a late joiner.

        first: number in the call of its first frame packet.
        Raises `ProtocolError` if the packet is damaged or of another call.
        """
        if self.current is None:
            self.current = ReceivedModel(packet, frame_decoder_for(packet), first)
            self.current = self._with_layers(self.current)
            return
        known = (self.update or self.current).model
        if packet.version > known.version:
            check_update(known.call, packet.call)
            self.update = ReceivedModel(packet, frame_decoder_for(packet), first)
            self.update = self._with_layers(self.update)
        elif self.current.model.with_missing_pictures_from(packet) != self.current.model:
            # A decoder that joined at an update receives the pictures before it later.
            check_update(self.current.model.call, packet.call)
            self.current = _with_pictures(self.current, packet)

    def receive_layer(self, packet: LayerPacket) -> None:
        """Enter a layer; a late joiner may receive it before its model.

        Raises `ProtocolError` if it is damaged.
        """
        current, update = self.current, self.update
        if current is None or packet.model_version >= current.model.version:
            self._layers.add(packet)
        if current is not None and packet.model_version == current.model.version:
            self.current = self._with_layers(current)
        elif update is not None and packet.model_version == update.model.version:
            # Before the update is activated, lest damage affect its first frame.
            self.update = self._with_layers(update)

    def activate(self) -> None:
        """Decode frame packets by the update from now on."""
        assert self.current is not None and self.update is not None
        completed = self.next_model
        assert completed is not None
        self.current, self.update = replace(self.update, model=completed), None
        self._layers.drop_before(self.current.model.version)

    def _with_layers(self, version: ReceivedModel) -> ReceivedModel:
        return replace(version, model=self._layers.apply(version.model))


def check_update(call: CallParameters, update: CallParameters) -> None:
    """Raise `ProtocolError` if an update belongs to another call."""
    for one, other in ((call.profile, update.profile), (picture_of(call), picture_of(update))):
        if one != other:
            raise ProtocolError(f"an update is of another call: {other}, expected {one}")


def picture_of(call: CallParameters) -> tuple[int, int, int, int]:
    """Width and height of a call's pictures, numerator and denominator of their rate."""
    return call.width, call.height, call.fps_numerator, call.fps_denominator


def _with_pictures(version: ReceivedModel, other: ModelPacket) -> ReceivedModel:
    return replace(version, model=version.model.with_missing_pictures_from(other))
