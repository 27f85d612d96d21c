"""The place of the newest packet in its call, and what a file from there on begins with."""

from collections import deque

from protocol.frames.frame_times import TimesPacket
from protocol.link.delivery.model_cache import ModelCache
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    PacketKind,
    packet_kind,
    parse_packet,
    serialise,
)
from protocol.voice.packet_clock import PacketClock
from protocol.voice.voice_block import split_payload

_CAMERA = ControlKind.CAMERA_OFF, ControlKind.CAMERA_ON


class CallPosition:
    """Gets every packet of one call.

    begin: the source frame with which a file begins whose first frame packet is the newest; 0 for
        the first packet of the call.  None: the newest packet has no face, or is late.
    end: source frame after those of the packets so far.
    is_over: the END packet has come.
    """

    def __init__(self) -> None:
        self.begin: int | None = None
        self.end, self.is_over = 0, False
        self._models, self._clock = ModelCache(), PacketClock()
        # The newest may be ahead of the frames.
        self._times = deque[bytes](maxlen=2)
        self._camera: bytes | None = None

    @property
    def has_model(self) -> bool:
        """Whether a model packet has come."""
        return self._clock.call is not None

    @property
    def head(self) -> list[bytes]:
        """The packets before the first frame packet of a file that begins with `begin`."""
        packets = list(self._models.packets)
        first = next(i for i, each in enumerate(packets) if packet_kind(each) is PacketKind.MODEL)
        head = [packets.pop(first)]
        if self.begin:
            # In front of updates: their first packet is counted from here.
            head.append(serialise(ControlPacket(0, ControlKind.JOINED, self.begin)))
        camera = [self._camera] if self._camera is not None else []
        return [*head, *packets, *self._times, *camera]

    def add(self, data: bytes, number: int | None) -> None:
        """Take the next packet, serialised.  number: see `Arrival`.

        Raises `ProtocolError` if it is none.
        """
        packet = parse_packet(data)
        self._models.on_sent(data)
        self.begin = None
        if isinstance(packet, ModelPacket):
            self._clock.add_model(packet, number)
        elif isinstance(packet, TimesPacket):
            self._times.append(data)
        elif isinstance(packet, ControlPacket):
            self._add_control(packet, data)
        elif isinstance(packet, FramePacket) and self.has_model:
            self._add_frames(packet, number)

    def _add_control(self, packet: ControlPacket, data: bytes) -> None:
        if packet.kind in _CAMERA:
            self._camera = data if packet.kind is ControlKind.CAMERA_OFF else None
            return
        self.is_over = packet.kind is ControlKind.END
        # Only the last packet of a call may have fewer faces than others, and END tells.
        self.end = packet.frame if self.is_over else max(self.end, packet.frame)
        if packet.kind is ControlKind.FACE_FOUND:
            self._clock.resume(packet.frame)

    def _add_frames(self, packet: FramePacket, known: int | None) -> None:
        clock, before = self._clock, self._clock.newest
        has_face = clock.voice == "off" or split_payload(clock.voice, packet.payload)[0].has_face
        number = clock.add_packet(packet.sequence, known)
        self.end = max(self.end, clock.end_frame(number))
        if has_face and number > before:
            self.begin = 0 if clock.begins_call(number) else clock.first_frame(number)
