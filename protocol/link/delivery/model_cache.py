"""The model and layer packets that a decoder needs when it joins a call late."""

from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import PacketKind, packet_kind, parse_packet, serialise


class ModelCache:
    """The model and layer packets of the versions in use and to come.

    An update is in use from the frame packet on that has its sequence number.  Then the cache drops
    older versions with their layers, since later frame packets are not coded by them.
    """

    def __init__(self) -> None:
        # With the model's version.  Replaced as a whole, so any thread may read it.
        self._packets: tuple[tuple[int, bytes], ...] = ()
        self._model: ModelPacket | None = None
        self._update: ModelPacket | None = None

    @property
    def packets(self) -> tuple[bytes, ...]:
        """The packets for a decoder that joins now, in order."""
        return tuple(packet for _, packet in self._packets)

    def on_sent(self, packet: bytes) -> None:
        """Take note of a packet that has been sent.  Raises `ProtocolError` if it is invalid."""
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
        """Drop the versions before `update`, which is in use now."""
        # A decoder that joins now lacks the pictures that an update leaves as they were.
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
