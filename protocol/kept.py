"""What an encoder keeps for decoders that join late: the models in use and to come."""

from protocol.messages import SEQUENCE_MODULUS, Kind, ModelPacket, packet_kind, parse_packet


class Kept:
    """Model and layer packets of one call, noted in order with its frame packets.

    An update is in use from the frame packet on whose sequence number it bears.  Then the models
    before it and their layers are let go of: who joins would draw frames by them that are not
    theirs.
    """

    def __init__(self) -> None:
        # With the number of the model; replaced, never changed, so that any thread may read it.
        self._packets: tuple[tuple[int, bytes], ...] = ()
        self._update: ModelPacket | None = None

    @property
    def packets(self) -> tuple[bytes, ...]:
        """What who joins now should have, in order."""
        return tuple(packet for _, packet in self._packets)

    def note(self, packet: bytes) -> None:
        """A packet has been sent.  Raises `ProtocolError` if it is none."""
        kind, number = packet_kind(packet), packet[0] % SEQUENCE_MODULUS
        if kind is Kind.LAYER:
            self._packets += ((number, packet),)
        elif kind is Kind.MODEL:
            model = parse_packet(packet)
            assert isinstance(model, ModelPacket)
            self._update = model if self._packets else None
            self._packets += ((model.layer, packet),)
        elif kind is Kind.FRAME and self._update and number == self._update.sequence:
            oldest, self._update = self._update.layer, None
            self._packets = tuple(kept for kept in self._packets if kept[0] >= oldest)
