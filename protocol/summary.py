"""Summary of a call file: bytes of each part, rates, duration."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from protocol.bit_accounting import BitAccounting, PacketSize
from protocol.call_file import CallReader
from protocol.call_parameters import CallParameters
from protocol.call_records import TruncatedCall
from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ, thesis_sample_count
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    Packet,
    PacketKind,
    packet_kind,
    parse_packet,
)
from protocol.voice.voice_block import split_payload


@dataclass(frozen=True, slots=True)
class CallSummary:
    """Bytes and rates of one call file.

    frames, duration_s, fps, width, height: of the source.
    coded_fps: coded frames per second; the decoder interpolates the other source frames.
    colour_matrix: of the source's Y'CbCr, see `CallParameters`.
    model_bytes, frame_bytes, control_bytes: payload by kind of packet; layers count as model.
    voice, voice_bytes: codec of the voice, one of `VOICES`, and its share of the frame packets,
        which `frame_bytes` does not count.
    container_bytes: magic, record lengths and byte 0 of each packet; `file_bytes` is the sum of
        these five.
    model_packets, layer_packets, frame_packets: numbers of packets.
    frame_bps: payload bits of the faces in frame packets per second of their nominal duration.
    voice_bps: payload bits of the voice in them, likewise.
    packet_bps: `frame_bps` with byte 0 of each frame packet.
    record_bps: `packet_bps` with the record length that each packet has without voice, which
        `--bitrate` bounds.
    complete: the call has an END packet.
    trailing_bytes: bytes after the END packet; `container_bytes` includes them.
    damaged_packets: number of packets that cannot be parsed; their bytes count as container.
    packet_size: of the frame packets, without voice; None without any.
    model_parts: bytes by part; their sum is `model_bytes`.
    groups: bytes by group of parameters, see `bit_accounting`; their sum is `frame_bytes`.
    group_bits: `groups` in bits per source frame.
    """

    profile: str
    frames: int
    fps: float
    coded_fps: float
    duration_s: float
    width: int
    height: int
    colour_matrix: str
    voice: str
    model_bytes: int
    frame_bytes: int
    voice_bytes: int
    control_bytes: int
    container_bytes: int
    file_bytes: int
    model_packets: int
    layer_packets: int
    frame_packets: int
    frame_bps: float
    voice_bps: float
    packet_bps: float
    record_bps: float
    complete: bool
    trailing_bytes: int
    damaged_packets: int
    packet_size: PacketSize | None
    model_parts: dict[str, int]
    groups: dict[str, float]
    group_bits: dict[str, float]


def summarise(path: Path, shown_frames: int | None = None) -> CallSummary:
    """The summary of the call file at `path`, which may be truncated or damaged.

    shown_frames: number of source frames of a truncated call; None: as its packets imply.
    Raises `ProtocolError` if the file is not a call file, `UserError` if it cannot be read.
    """
    counter, accounting = _ByteCounter(shown_frames), BitAccounting()
    with CallReader(path) as reader:
        begin = reader.offset
        for data in reader.undamaged(counter.note_damage):
            counter.add(data, accounting, reader.offset - begin)
            begin = reader.offset
        return counter.summary(accounting, reader)


class _ByteCounter:
    """Counts packets and their bytes."""

    def __init__(self, shown_frames: int | None) -> None:
        self.shown_frames = shown_frames
        self.call: CallParameters | None = None
        self.payload = {kind: 0 for kind in PacketKind}
        self.packets = {kind: 0 for kind in PacketKind}
        self.voice_bytes = 0  # of frame packets; `payload` does not count them
        self.frame_records = 0  # bytes of the records of frame packets, as if without voice
        self.end: int | None = None  # `frame` of the END packet
        self.damaged = 0
        self.first_damage: ProtocolError | None = None

    def note_damage(self, error: ProtocolError) -> None:
        # An incomplete record at the end counts as container.
        self.damaged += not isinstance(error, TruncatedCall)
        self.first_damage = self.first_damage or error

    def add(self, data: bytes, accounting: BitAccounting, record_bytes: int) -> None:
        try:
            packet = self._without_voice(parse_packet(data))
            if packet is not None:
                accounting.add(packet)
        except ProtocolError as error:
            self.note_damage(error)
            return
        kind, voice_bytes = packet_kind(data), 0
        if isinstance(packet, FramePacket):
            voice_bytes = len(data) - 1 - len(packet.payload)
            lengths = encode_varint(2 * len(data)), encode_varint(2 * (len(data) - voice_bytes))
            self.frame_records += record_bytes - voice_bytes - len(lengths[0]) + len(lengths[1])
        elif packet is None:
            voice_bytes = len(data) - 1
        self.voice_bytes += voice_bytes
        self.payload[kind] += len(data) - 1 - voice_bytes
        self.packets[kind] += packet is not None
        if isinstance(packet, ModelPacket):
            self.call = self.call or packet.call
        elif isinstance(packet, ControlPacket) and packet.kind is ControlKind.END:
            self.end = packet.frame

    def _without_voice(self, packet: Packet) -> Packet | None:
        """The packet without its voice; None: it has no face.  Raises `ProtocolError`."""
        if self.call is None or self.call.voice == "off" or not isinstance(packet, FramePacket):
            return packet
        block, face = split_payload(self.call.voice, packet.payload)
        return FramePacket(packet.sequence, face) if block.has_face else None

    def _frames(self, call: CallParameters) -> int:
        if self.end is not None:
            return self.end
        if self.shown_frames is not None:
            return self.shown_frames
        return _frames_of(call, self.packets[PacketKind.FRAME])

    def summary(self, accounting: BitAccounting, reader: CallReader) -> CallSummary:
        call, groups, file_bytes = self.call, accounting.groups, reader.file_bytes
        if call is None:
            raise self.first_damage or ProtocolError("it has no model packet")
        frames = self._frames(call)
        frame_bits = 8 * self.payload[PacketKind.FRAME]
        seconds = nominal_duration_s(
            call.profile, frames, Fraction(call.fps_numerator, call.fps_denominator)
        )
        return CallSummary(
            profile=call.profile,
            frames=frames,
            fps=call.fps,
            coded_fps=_coded_fps(call),
            duration_s=frames / call.fps,
            width=call.source_size[0],
            height=call.source_size[1],
            colour_matrix=call.colour_matrix,
            voice=call.voice,
            model_bytes=self.payload[PacketKind.MODEL] + self.payload[PacketKind.LAYER],
            frame_bytes=self.payload[PacketKind.FRAME],
            voice_bytes=self.voice_bytes,
            control_bytes=self.payload[PacketKind.CONTROL],
            container_bytes=file_bytes - sum(self.payload.values()) - self.voice_bytes,
            file_bytes=file_bytes,
            model_packets=self.packets[PacketKind.MODEL],
            layer_packets=self.packets[PacketKind.LAYER],
            frame_packets=self.packets[PacketKind.FRAME],
            frame_bps=frame_bits / seconds,
            voice_bps=8 * self.voice_bytes / seconds,
            packet_bps=(frame_bits + 8 * self.packets[PacketKind.FRAME]) / seconds,
            record_bps=8 * self.frame_records / seconds,
            complete=reader.complete,
            trailing_bytes=reader.trailing_bytes,
            damaged_packets=self.damaged,
            packet_size=accounting.packet_size,
            model_parts=accounting.model_parts,
            groups=groups,
            group_bits={name: 8 * count / max(frames, 1) for name, count in groups.items()},
        )


def _frames_of(call: CallParameters, frame_packets: int) -> int:
    """Source frames of a truncated call, from the number of its frame packets."""
    if call.profile == "thesis":
        return round(frame_packets / THESIS_RATE_HZ * call.fps)
    return frame_packets * call.frames_per_packet * call.frame_step


def _coded_fps(call: CallParameters) -> float:
    return THESIS_RATE_HZ if call.profile == "thesis" else call.fps / call.frame_step


def nominal_duration_s(profile: str, frames: int, fps: Fraction) -> float:
    """Time covered by the frame packets of `frames` source frames, more than 0.

    A packet of the thesis profile covers a tenth of a second, so its stream has exactly the nominal
    rate.
    """
    if profile == "thesis":
        return max(thesis_sample_count(frames, fps.numerator, fps.denominator), 1) / THESIS_RATE_HZ
    return float(max(frames, 1) / fps)
