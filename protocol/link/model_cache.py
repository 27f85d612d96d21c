"""What an encoder keeps for decoders that join late: the models in use and to come."""

from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import PacketKind, packet_kind, parse_packet, serialise


class ModelCache:
    """Model and layer packets of one call, noted in order with its frame packets.

    An update is in use from the frame packet on whose sequence number it bears.  Then the models
    before it and their layers are let go of: who joins would draw frames by them that are not
    theirs.
    """

    def __init__(self) -> None:
        # With the number of the model; replaced, never changed, so that any thread may read it.
        self._packets: tuple[tuple[int, bytes], ...] = ()
        self._model: ModelPacket | None = None
        self._update: ModelPacket | None = None

    @property
    def packets(self) -> tuple[bytes, ...]:
        """What who joins now should have, in order."""
        return tuple(packet for _, packet in self._packets)

    def on_sent(self, packet: bytes) -> None:
        """A packet has been sent.  Raises `ProtocolError` if it is none."""
        kind, number = packet_kind(packet), packet[0] % SEQUENCE_MODULUS
        if kind is PacketKind.LAYER:
            self._packets += ((number, packet),)
        elif kind is PacketKind.MODEL:
            model = parse_packet(packet)
            assert isinstance(model, ModelPacket)
            if self._model is None:
                self._model = model
            else:
                self._update = model
            self._packets += ((model.version, packet),)
        elif kind is PacketKind.FRAME and self._update and self._model:
            past = (number - self._update.sequence) % SEQUENCE_MODULUS
            if past < SEQUENCE_MODULUS // 2:
                self._activate(self._update, self._model)

    def _activate(self, update: ModelPacket, before: ModelPacket) -> None:
        """Frame packets are of `update` now."""
        # Who joins now has never seen the pictures that stay.
        self._update, self._model = None, update.with_missing_pictures_from(before)
        whole = serialise(self._model)
        self._packets = tuple(
            (
                number,
                whole
                if packet_kind(packet) is PacketKind.MODEL and number == update.version
                else packet,
            )
            for number, packet in self._packets
            if number >= update.version
        )
