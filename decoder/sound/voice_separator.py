"""Takes the voice out of the packets of a call, so that the playout sees calls without one."""

from decoder.sound.speech_frames import SpeechFrames
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, Packet
from protocol.voice.packet_clock import PacketClock
from protocol.voice.voice_block import split_payload


class VoiceSeparator:
    """Receives every packet of one start of an encoder, as it comes, before the playout does.

    Over a link frame packets follow after a model packet.

    speech: the speech frames received.
    voice_bytes: so many bytes of frame packets were voice.
    """

    def __init__(self) -> None:
        self.speech, self.voice_bytes = SpeechFrames(), 0
        self._clock = PacketClock()

    @property
    def voice(self) -> str:
        """The codec of the call's voice, one of `VOICES`; "off" before a model packet."""
        return self._clock.voice

    def receive(self, packet: Packet, number: int | None = None) -> Packet | None:
        """The packet without its voice; None: it has no face.

        number: of the packet in the call, as `Arrival` has it.
        Raises `ProtocolError` if the voice is damaged.
        """
        if isinstance(packet, FramePacket) and self._clock.voice != "off":
            return self._split(packet, number)
        self._follow(packet, number)
        return packet

    def _follow(self, packet: Packet, number: int | None) -> None:
        if isinstance(packet, ModelPacket):
            self._clock.add_model(packet, number)
        elif not isinstance(packet, ControlPacket):
            return
        elif packet.kind is ControlKind.FACE_FOUND:
            self._clock.resume(packet.frame)
        elif packet.kind is ControlKind.JOINED and number is None:
            self._clock.join(packet.frame)

    def _split(self, packet: FramePacket, number: int | None) -> Packet | None:
        block, face = split_payload(self._clock.voice, packet.payload)
        self.voice_bytes += len(packet.payload) - len(face)
        number = self._clock.add_packet(packet.sequence, number)
        first = self._clock.expected(number) + block.offset
        self.speech.add(number, first, block.frames)
        return FramePacket(packet.sequence, face) if block.has_face else None
