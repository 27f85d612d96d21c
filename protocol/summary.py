"""What is in a call file: bytes of each part, rates, duration."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from protocol.bit_accounting import BitAccounting, PacketSize
from protocol.call_file import CallReader, TruncatedCall, serialise_record
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ, thesis_sample_count
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    PacketKind,
    packet_kind,
    parse_packet,
)


@dataclass(frozen=True, slots=True)
class CallSummary:
    """Bytes and rates of one call file.

    frames, duration_s, fps, width, height: of the source.
    coded_fps: frames a second that were coded; those between are interpolated.
    matrix: of the source's Y'CbCr, see `CallParameters`.
    model_bytes, frame_bytes, control_bytes: payload of the packets of each kind; layers are model.
    model_packets, layer_packets: numbers of packets that say who it is.
    container_bytes: magic, record lengths and byte 0 of each packet; with the three above it makes
        `file_bytes`.
    frame_packets: number of frame packets.
    frame_bps: bits of frame payload per second of the time the frame packets are due in.
    packet_bps: the same with byte 0 of each frame packet.
    record_bps: the same with its length in the file, too: what an encoder's `--bitrate` bounds.
    complete: the call has its END packet.
    trailing_bytes: after the END packet, of no call; `container_bytes` has them in it.
    damaged_packets: that are none, or hold what cannot be; their bytes count as container.
    packet_size: of the frame packets; None without any.
    model_parts: bytes by part; they add up to `model_bytes`.
    groups: bytes by group of parameters, see `accounting`; they add up to `frame_bytes`.
    group_bits: the same in bits a source frame.
    """

    profile: str
    frames: int
    fps: float
    coded_fps: float
    duration_s: float
    width: int
    height: int
    colour_matrix: str
    model_bytes: int
    frame_bytes: int
    control_bytes: int
    container_bytes: int
    file_bytes: int
    model_packets: int
    layer_packets: int
    frame_packets: int
    frame_bps: float
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
    """Account for every byte of the call file at `path`; it may be truncated or damaged.

    shown_frames: of a truncated call, which does not tell; None: as many as its packets can hold.
    Raises `ProtocolError` if it is no call, `UserError` if it cannot be read.
    """
    tally, accounts = _ByteCounter(shown_frames), BitAccounting()
    with CallReader(path) as reader:
        try:
            for data in reader:
                tally.add(data, accounts)
        except TruncatedCall:
            # The torn record is no packet and counts as container.
            if tally.call is None:
                raise
        except ProtocolError as error:
            # Where a packet's length is damaged nothing can be told of what follows.
            tally.note_damage(error)
        return tally.summary(accounts, reader)


class _ByteCounter:
    """Adds up packets."""

    def __init__(self, shown_frames: int | None) -> None:
        self.shown_frames = shown_frames
        self.call: CallParameters | None = None
        self.payload = {kind: 0 for kind in PacketKind}
        self.packets = {kind: 0 for kind in PacketKind}
        self.frame_records = 0  # bytes of frame packets with what the file puts around them
        self.end: int | None = None  # what the END packet says
        self.damaged = 0
        self.first_damage: ProtocolError | None = None

    def note_damage(self, error: ProtocolError) -> None:
        self.damaged += 1
        self.first_damage = self.first_damage or error

    def add(self, data: bytes, accounts: BitAccounting) -> None:
        try:
            packet = parse_packet(data)
            accounts.add(packet)
        except ProtocolError as error:
            self.note_damage(error)
            return
        self.payload[packet_kind(data)] += len(data) - 1
        self.packets[packet_kind(data)] += 1
        if isinstance(packet, FramePacket):
            self.frame_records += len(serialise_record(data))
        if isinstance(packet, ModelPacket):
            self.call = self.call or packet.call
        elif isinstance(packet, ControlPacket) and packet.kind is ControlKind.END:
            self.end = packet.frame

    def _frames(self, call: CallParameters) -> int:
        if self.end is not None:
            return self.end
        if self.shown_frames is not None:
            return self.shown_frames
        return _frames_of(call, self.packets[PacketKind.FRAME])

    def summary(self, accounts: BitAccounting, reader: CallReader) -> CallSummary:
        call, groups, file_bytes = self.call, accounts.groups, reader.file_bytes
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
            width=call.width,
            height=call.height,
            colour_matrix=call.colour_matrix,
            model_bytes=self.payload[PacketKind.MODEL] + self.payload[PacketKind.LAYER],
            frame_bytes=self.payload[PacketKind.FRAME],
            control_bytes=self.payload[PacketKind.CONTROL],
            container_bytes=file_bytes - sum(self.payload.values()),
            file_bytes=file_bytes,
            model_packets=self.packets[PacketKind.MODEL],
            layer_packets=self.packets[PacketKind.LAYER],
            frame_packets=self.packets[PacketKind.FRAME],
            frame_bps=frame_bits / seconds,
            packet_bps=(frame_bits + 8 * self.packets[PacketKind.FRAME]) / seconds,
            record_bps=8 * self.frame_records / seconds,
            complete=reader.complete,
            trailing_bytes=reader.trailing_bytes,
            damaged_packets=self.damaged,
            packet_size=accounts.packet_size,
            model_parts=accounts.model_parts,
            groups=groups,
            group_bits={name: 8 * count / max(frames, 1) for name, count in groups.items()},
        )


def _frames_of(call: CallParameters, frame_packets: int) -> int:
    """Source frames of a truncated call, from the packets that are there."""
    if call.profile == "thesis":
        return round(frame_packets / THESIS_RATE_HZ * call.fps)
    return frame_packets * call.frames_per_packet * call.frame_step


def _coded_fps(call: CallParameters) -> float:
    return THESIS_RATE_HZ if call.profile == "thesis" else call.fps / call.frame_step


def nominal_duration_s(profile: str, frames: int, fps: Fraction) -> float:
    """Time that the frame packets of `frames` source frames stand for, more than 0.

    A thesis sample stands for a tenth of a second, the last one too, so a whole stream of them has
    exactly its nominal rate.
    """
    if profile == "thesis":
        return max(thesis_sample_count(frames, fps.numerator, fps.denominator), 1) / THESIS_RATE_HZ
    return float(max(frames, 1) / fps)
