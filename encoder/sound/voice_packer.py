"""Puts the speech of a call into its frame packets."""

from dataclasses import replace

from encoder.sound.speech_coder import SpeechSource
from protocol.limits import MAX_FRAME_PAYLOAD_BYTES, SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket
from protocol.voice.packet_clock import PacketClock
from protocol.voice.voice_block import MAX_SPEECH_FRAMES, VoiceBlock, join_payload

Frames = tuple[bytes | None, ...]


class VoicePacker:
    """Adds a voice to the packets of one call, in the order in which they are sent.

    What does not fit into a packet goes into the next one.
    voice_bytes: so many bytes it has added to frame packets.
    """

    def __init__(self, speech: SpeechSource) -> None:
        self._speech, self._clock = speech, PacketClock()
        self._first = 0  # number of the first waiting frame
        self._waiting: list[bytes | None] = []
        self.voice_bytes = 0

    def model(self, packet: ModelPacket) -> ModelPacket:
        """A model packet that names the codec."""
        named = replace(packet, call=replace(packet.call, voice=self._speech.voice))
        self._clock.add_model(named)
        return named

    def packet(self, number: int, face: bytes) -> FramePacket:
        """Frame packet `number` of the call, with the face and the speech that it has time for."""
        sequence = number % SEQUENCE_MODULUS
        number = self._clock.add_packet(sequence)
        self._take(self._clock.end(number))
        return self._filled(number, face, has_face=True)

    def resume(self, frame: int) -> None:
        """A face has been found again in source frame `frame`."""
        self._clock.resume(frame)

    def packets_without_face(self, frame: int) -> list[FramePacket]:
        """The packets due up to source frame `frame`, which shows no face."""
        packets = []
        for number in self._clock.packets_until(frame):
            self._clock.add_packet(number % SEQUENCE_MODULUS)
            self._take(self._clock.end(number))
            packets.append(self._filled(number, b"", has_face=False))
        return packets

    def last_packets(self, frames: int) -> list[FramePacket]:
        """What is left of the speech of a call of so many source frames."""
        self._take(self._clock.speech_frame(frames))
        packets = []
        while any(frame is not None for frame in self._waiting):
            number = self._clock.newest + 1
            self._clock.add_packet(number % SEQUENCE_MODULUS)
            packets.append(self._filled(number, b"", has_face=False))
        return packets

    def _take(self, end: int) -> None:
        self._waiting += self._speech.take(end)

    def _filled(self, number: int, face: bytes, has_face: bool) -> FramePacket:
        """A packet with as much of the waiting speech as it can take."""
        self._skip_silence()
        voice = self._speech.voice
        offset = self._first - self._clock.expected(number)
        count = min(len(self._waiting), MAX_SPEECH_FRAMES)
        while True:
            frames = without_silent_end(tuple(self._waiting[:count]))
            block = VoiceBlock(frames, offset if frames else 0, has_face)
            payload = join_payload(voice, block, face)
            if len(payload) <= MAX_FRAME_PAYLOAD_BYTES or not frames:
                break
            count = len(frames) - 1
        self._first, self._waiting = self._first + count, self._waiting[count:]
        self.voice_bytes += len(payload) - len(face)
        return FramePacket(number % SEQUENCE_MODULUS, payload)

    def _skip_silence(self) -> None:
        """Leave out silent frames in front where they would take a mask."""
        silent = next((i for i, frame in enumerate(self._waiting) if frame is not None), None)
        if silent is None:
            self._first, self._waiting = self._first + len(self._waiting), []
        elif None not in self._waiting[silent:]:
            self._first, self._waiting = self._first + silent, self._waiting[silent:]


def without_silent_end(frames: Frames) -> Frames:
    """Frames up to the last one that is not silent."""
    count = max((i + 1 for i, frame in enumerate(frames) if frame is not None), default=0)
    return frames[:count]
