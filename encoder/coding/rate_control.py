"""Rate control: the quality of each packet of a call, offline and online."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Any

from numpy.typing import NDArray

from encoder.coding.rdo_quantiser import CodedPacket, code_packet
from encoder.picture_coding.quantiser_search import finest_quantiser_within
from protocol.entropy.varint import encode_varint
from protocol.frames.temporal_prediction import FramePredictor
from protocol.limits import SEQUENCE_MODULUS
from shared_model.arrays import Array

# The rate holds in any window of this length.
WINDOW_S = 5.0
QUALITIES = 32
# Packets alternate between two neighbouring qualities, in a pattern of this length, so that the
# mean quality has this many levels per quality.
QUALITY_INTERLEAVE = 8
# The first level of the search, and the levels by which the bits halve.
INITIAL_LEVEL = 64
LEVELS_PER_HALVING = 45.0
# Reservoir of a live call, seconds of its rate, and the largest gain of quality per packet.
RESERVOIR_S = 2.0
MAX_QUALITY_GAIN = 3
# The share of its bits that a packet of a live call in debt may take.  Every model that a call
# switches to begins with a whole frame: repaid at once, that makes what follows coarse.
DEBT_SHARE = 0.9


@dataclass(frozen=True, slots=True)
class RateTarget:
    """The rate of all packets, bits per second, for frames at a rate and packet length."""

    bitrate: float
    fps: float
    frames_per_packet: int

    def is_brief(self, frames: int) -> bool:
        """Whether so many frames are less than a second, so that the first frame sets the rate."""
        return frames < self.fps

    def overshoot_message(self, bits: int, frames: int) -> str | None:
        """The warning if `bits` exceed the rate of `frames` frames, else None."""
        if bits <= self.bitrate * frames / self.fps:
            return None
        taken = ceil(bits * self.fps / frames)
        return (
            f"--bitrate {self.bitrate:g} is too little:"
            f" as coarse as can be, this call takes {taken} bits a second"
        )


def code_call(values: Array, scale_codes: NDArray[Any], target: RateTarget) -> list[CodedPacket]:
    """Code all frames of a recorded call at its target rate.

    values: (t, n) component values, units.  scale_codes: see `FrameTransform`.
    All packets have the finest common level that meets the rate.  Packets that would exceed the
    rate in a window of `WINDOW_S` are coarser.
    """

    def code(level: int) -> list[CodedPacket]:
        return _code_packets(values, scale_codes, target, level)

    def total_bits(packets: list[CodedPacket]) -> int:
        return sum(map(packet_bits, packets))

    levels = range(QUALITY_INTERLEAVE * (QUALITIES - 1) + 1)
    max_bits = target.bitrate * len(values) / target.fps
    _, packets = finest_quantiser_within(
        code, total_bits, max_bits, levels, INITIAL_LEVEL, LEVELS_PER_HALVING
    )
    return packets


def packet_bits(packet: CodedPacket) -> int:
    """Bits of a packet in a call file: length, byte 0 and payload."""
    size = 1 + len(packet.payload)
    return 8 * (len(encode_varint(size)) + size)


def packet_quality(level: int, number: int) -> int:
    """The quality of packet `number` at a level, counted in 1 / `QUALITY_INTERLEAVE` quality."""
    return (
        level + number * (QUALITY_INTERLEAVE // 2 + 1) % QUALITY_INTERLEAVE
    ) // QUALITY_INTERLEAVE


def _code_packets(
    values: Array, scale_codes: NDArray[Any], target: RateTarget, level: int
) -> list[CodedPacket]:
    predictor, window = FramePredictor(scale_codes), SlidingWindowBudget(target)
    packets = []
    spans = packet_spans(len(values), target.frames_per_packet)
    for number, (start, end) in enumerate(spans):

        def encode(quality: int, number: int = number) -> CodedPacket:
            targets, *following = (values[slice(*span)] for span in spans[number : number + 2])
            return code_packet(
                predictor,
                number % SEQUENCE_MODULUS,
                target.frames_per_packet,
                targets,
                quality,
                intra=number == 0,
                next_targets=following[0] if following else None,
            )

        quality = packet_quality(level, number)
        packet = window.encode_within_budget(encode, quality, end - start)
        predictor.anchor = packet.frames[-1]
        packets.append(packet)
    return packets


def packet_spans(frames: int, frames_per_packet: int) -> list[tuple[int, int]]:
    """First frame and end of each packet: one frame, then `frames_per_packet` each."""
    starts = [0, *range(1, frames, frames_per_packet)]
    return list(zip(starts, [*starts[1:], frames], strict=True))


class OnlineRateController:
    """Codes the packets of a live call at a target rate.

    Unused bits are saved in a reservoir of `RESERVOIR_S`.
    """

    def __init__(self, target: RateTarget) -> None:
        self._target, self._window = target, SlidingWindowBudget(target)
        self._credit = 0.0
        self._quality = 0
        self._frames = self._coarsest_frames = self._coarsest_bits = 0
        # Bits above the rate from the start of the call to the end of each packet of a window.
        window = ceil(WINDOW_S * target.fps / target.frames_per_packet)
        self._overspend = deque([0.0], window)

    def encode_packet(self, predictor: FramePredictor, number: int, targets: Array) -> CodedPacket:
        """Code frames (count, n), units, as packet `number`, as finely as the budget allows."""
        target = self._target
        earned = target.bitrate * len(targets) / target.fps
        self._credit = min(self._credit + earned, target.bitrate * RESERVOIR_S)

        def encode(quality: int) -> CodedPacket:
            sequence, nominal = number % SEQUENCE_MODULUS, target.frames_per_packet
            return code_packet(predictor, sequence, nominal, targets, quality, intra=number == 0)

        # A first frame may take one second of the rate; a debt is repaid by later packets.
        limit = max(self._credit, DEBT_SHARE * earned) if number else target.bitrate
        limit = min(limit, self._window.available_bits(len(targets)))
        # What is finer in the first frame of another model than around it is lost in what follows.
        finest = max(0, self._quality - (MAX_QUALITY_GAIN if number else 0))
        self._quality, packet = _finest_packet_within(encode, limit, finest, self._quality)
        self._account(packet, len(targets), earned)
        return packet

    def _account(self, packet: CodedPacket, frames: int, earned: float) -> None:
        bits = packet_bits(packet)
        self._window.charge(packet, frames)
        self._credit -= bits
        self._frames += frames
        self._overspend.append(self._overspend[-1] + bits - earned)
        if self._quality == QUALITIES - 1:
            self._coarsest_frames += frames
            self._coarsest_bits += bits

    @property
    def overshoot_message(self) -> str | None:
        """The warning that the target rate is too low, else None.

        It is too low if the call exceeded its rate at every packet of the last window, or if the
        coarsest packets alone exceed the rate of the whole call; a call of less than a second has
        no rate.
        """
        if self._target.is_brief(self._frames):
            return None
        too_much = self._target.overshoot_message(self._coarsest_bits, self._frames)
        if min(self._overspend) <= 0 and too_much is None:
            return None
        return self._target.overshoot_message(self._coarsest_bits, self._coarsest_frames)


class SlidingWindowBudget:
    """Bits that the next packet may take so that no window of `WINDOW_S` exceeds the rate."""

    def __init__(self, target: RateTarget) -> None:
        self._target = target
        self._packets: list[tuple[float, int]] = []  # seconds, bits of the packets in the window

    def available_bits(self, frames: int) -> float:
        """Bits available for a packet of `frames` frames."""
        seconds = frames / self._target.fps
        window_s = sum(duration for duration, _ in self._packets)
        while self._packets and window_s + seconds > WINDOW_S:
            window_s -= self._packets.pop(0)[0]
        # An incomplete first window has the budget of a whole one, for the intra frame.
        return self._target.bitrate * WINDOW_S - sum(bits for _, bits in self._packets)

    def encode_within_budget(
        self, encode: Callable[[int], CodedPacket], quality: int, frames: int
    ) -> CodedPacket:
        """The packet of `frames` frames at `quality`, or the finest within the available bits."""
        _, packet = _finest_packet_within(encode, self.available_bits(frames), quality, quality)
        self.charge(packet, frames)
        return packet

    def charge(self, packet: CodedPacket, frames: int) -> None:
        """Add a packet of `frames` frames to the window."""
        self._packets.append((frames / self._target.fps, packet_bits(packet)))


def _finest_packet_within(
    encode: Callable[[int], CodedPacket], max_bits: float, finest: int, first: int
) -> tuple[int, CodedPacket]:
    """The finest packet within `max_bits`, no finer than quality `finest`, and its quality.

    first: the first quality of the search.
    """
    qualities = range(finest, QUALITIES)
    halving = LEVELS_PER_HALVING / QUALITY_INTERLEAVE
    return finest_quantiser_within(encode, packet_bits, max_bits, qualities, first, halving)
