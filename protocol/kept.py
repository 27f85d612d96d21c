"""What an encoder keeps for decoders that join late: the models in use and to come."""

from dataclasses import replace

from protocol.messages import (
    SEQUENCE_MODULUS,
    Kind,
    ModelPacket,
    packet_kind,
    parse_packet,
    serialise,
)


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
        self._background = b""

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
            if not self._packets:
                self._background = model.background
            else:
                self._update = model
            self._packets += ((model.layer, packet),)
        elif kind is Kind.FRAME and self._update and number == self._update.sequence:
            self._enter(self._update)

    def _enter(self, update: ModelPacket) -> None:
        """Frame packets are of `update` now."""
        self._update = None
        if not update.background:
            # The one before stays; who joins now has never seen it.
            update = replace(update, background=self._background)
        self._background = update.background
        whole = serialise(update)
        self._packets = tuple(
            (
                number,
                whole if packet_kind(packet) is Kind.MODEL and number == update.layer else packet,
            )
            for number, packet in self._packets
            if number >= update.layer
        )
