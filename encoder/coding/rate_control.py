"""Holds the bit rate: which quality each packet of a call is coded at."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encoder.coding.rdo_quantiser import CodedPacket, code_packet
from encoder.picture_coding.quantiser_search import finest_within
from protocol.entropy.varint import encode_varint
from protocol.frames.temporal_prediction import FramePredictor
from protocol.packets import SEQUENCE_MODULUS

Array = NDArray[np.float64]

WINDOW_S = 5.0
QUALITIES = 32
# Packets of a call take turns between two neighbouring qualities: the rate is met more closely.
TURNS = 8
# Where the search for a call's level starts, and how many levels coarser it takes half the bits.
FIRST_LEVEL = 64
LEVELS_PER_HALVING = 45.0
# A live call saves up this many seconds of its rate; its packets may be this much finer than the
# one before.
CREDIT_S = 2.0
FINER = 3
# A call in debt spends this share of what it earns.
REPAYING = 0.75


@dataclass(frozen=True, slots=True)
class Spending:
    """The rate to hold: bits per second, frames per second, frames in a packet."""

    bitrate: float
    fps: float
    frames_per_packet: int

    def excess(self, bits: int, frames: int) -> str | None:
        """What to say of the coarsest packets if their bits are more than `frames` frames earn."""
        if bits <= self.bitrate * frames / self.fps:
            return None
        taken = ceil(bits * self.fps / frames)
        return (
            f"--bitrate {self.bitrate:g} is too little:"
            f" as coarse as can be, this call takes {taken} bits a second"
        )


def code_call(values: Array, spreads: NDArray[Any], spending: Spending) -> list[CodedPacket]:
    """All packets of a call whose component values (t, n), in units, are known beforehand.

    One level serves the whole call, the finest whose packets keep within the rate; packets that
    would take more than the rate within any window of `WINDOW_S` are coded more coarsely.
    """

    def code(level: int) -> list[CodedPacket]:
        return _code_all(values, spreads, spending, level)

    def bits(packets: list[CodedPacket]) -> int:
        return sum(map(packet_bits, packets))

    levels = range(TURNS * (QUALITIES - 1) + 1)
    allowed = spending.bitrate * len(values) / spending.fps
    return finest_within(code, bits, allowed, levels, FIRST_LEVEL, LEVELS_PER_HALVING)[1]


def packet_bits(packet: CodedPacket) -> int:
    """Bits of a packet in a call file: of its length, byte 0 and payload."""
    size = 1 + len(packet.payload)
    return 8 * (len(encode_varint(size)) + size)


def packet_quality(level: int, number: int) -> int:
    """The quality of packet `number` at a level, which counts in `1 / TURNS` quality."""
    return (level + number * (TURNS // 2 + 1) % TURNS) // TURNS


def _code_all(
    values: Array, spreads: NDArray[Any], spending: Spending, level: int
) -> list[CodedPacket]:
    predictor, purse = FramePredictor(spreads), Purse(spending)
    packets = []
    spans = packet_spans(len(values), spending.frames_per_packet)
    for number, (start, end) in enumerate(spans):

        def attempt(tried: int, number: int = number) -> CodedPacket:
            targets, *rest = (values[slice(*span)] for span in spans[number : number + 2])
            return code_packet(
                predictor,
                number % SEQUENCE_MODULUS,
                spending.frames_per_packet,
                targets,
                tried,
                fresh=number == 0,
                coming=rest[0] if rest else None,
            )

        quality = packet_quality(level, number)
        packet = purse.buy(attempt, quality, end - start)
        predictor.anchor = packet.frames[-1]
        packets.append(packet)
    return packets


def packet_spans(frames: int, frames_per_packet: int) -> list[tuple[int, int]]:
    """First frame and end of each packet: one frame first, then `frames_per_packet` each."""
    starts = [0, *range(1, frames, frames_per_packet)]
    return list(zip(starts, [*starts[1:], frames], strict=True))


class LivePurse:
    """Codes the packets of a call that is not known beforehand.

    What a calm stretch leaves over is credit for the next `CREDIT_S` seconds' worth at most.
    """

    def __init__(self, spending: Spending) -> None:
        self._spending, self._purse = spending, Purse(spending)
        self._credit = 0.0
        self._quality = 0
        self._frames = self._coarsest_frames = self._coarsest_bits = 0
        # Bits taken beyond what was earned, from the call's start to the ends of its last packets.
        window = ceil(WINDOW_S * spending.fps / spending.frames_per_packet)
        self._debts = deque([0.0], window)

    def code(self, predictor: FramePredictor, number: int, targets: Array) -> CodedPacket:
        """Packet `number` of frames (count, n), in units, as finely as there is credit for."""
        spending = self._spending
        earned = spending.bitrate * len(targets) / spending.fps
        self._credit = min(self._credit + earned, spending.bitrate * CREDIT_S)

        def attempt(quality: int) -> CodedPacket:
            sequence, usual = number % SEQUENCE_MODULUS, spending.frames_per_packet
            return code_packet(predictor, sequence, usual, targets, quality, fresh=number == 0)

        # All credit may go at once.  The first frame comes whole; debts are paid back.
        limit = max(self._credit, REPAYING * earned) if number else spending.bitrate
        limit = min(limit, self._purse.money(len(targets)))
        finest = max(0, self._quality - FINER)
        self._quality, packet = _within(attempt, limit, finest, self._quality)
        self._purse.pay(packet, len(targets))
        self._credit -= packet_bits(packet)
        self._frames += len(targets)
        self._debts.append(self._debts[-1] + packet_bits(packet) - earned)
        if self._quality == QUALITIES - 1:
            self._coarsest_frames += len(targets)
            self._coarsest_bits += packet_bits(packet)
        return packet

    @property
    def excess(self) -> str | None:
        """See `Spending.excess`: of a call that owed something all through its last window, or
        whose coarsest packets alone take more than all of it may; a busy end is no rate too low."""
        too_much = self._spending.excess(self._coarsest_bits, self._frames)
        if min(self._debts) <= 0 and too_much is None:
            return None
        return self._spending.excess(self._coarsest_bits, self._coarsest_frames)


class Purse:
    """What may be spent now so that no window holds more than its share."""

    def __init__(self, spending: Spending) -> None:
        self._spending = spending
        self._spent: list[tuple[float, int]] = []  # seconds, bits of the packets in the window

    def money(self, frames: int) -> float:
        """Bits that a packet of `frames` frames may take now."""
        seconds = frames / self._spending.fps
        held = sum(s for s, _ in self._spent)
        while self._spent and held + seconds > WINDOW_S:
            held -= self._spent.pop(0)[0]
        # Before a whole window has passed, the rest of it counts as already earned: the first frame
        # comes whole.
        return self._spending.bitrate * WINDOW_S - sum(bits for _, bits in self._spent)

    def buy(self, attempt: Callable[[int], CodedPacket], quality: int, frames: int) -> CodedPacket:
        """The packet of `frames` frames at `quality`, or the finest one there is money for."""
        _, packet = _within(attempt, self.money(frames), quality, quality)
        self.pay(packet, frames)
        return packet

    def pay(self, packet: CodedPacket, frames: int) -> None:
        """A packet of `frames` frames is sent."""
        self._spent.append((frames / self._spending.fps, packet_bits(packet)))


def _within(
    attempt: Callable[[int], CodedPacket], money: float, finest: int, first: int
) -> tuple[int, CodedPacket]:
    """The finest packet, no finer than `finest`, that there is money for, and its quality.

    first: tried first.
    """
    qualities = range(finest, QUALITIES)
    halving = LEVELS_PER_HALVING / TURNS
    return finest_within(attempt, packet_bits, money, qualities, first, halving)
