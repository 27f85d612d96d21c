"""The times of source frames that are not evenly spaced: packets of them, and a clock.

A time is stated as its deviation from that of a constant frame rate, frame index / fps, in ticks of
1 / `TICKS_PER_FRAME` of a frame.  A call whose source has a constant rate has no times packets.
"""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.integer_codes import code_bits
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder
from protocol.entropy.validation import check_int
from protocol.entropy.varint import MAX_VARINT, decode_varint, encode_varint
from protocol.limits import (
    MAX_FRAME_INDEX,
    MAX_TICK_STEP,
    MAX_TIMED_FRAMES,
    SEQUENCE_MODULUS,
)

TICKS_PER_FRAME = 16
MAX_TICKS = MAX_VARINT // 2
_COUNT_BITS = 6
# Contexts of a difference: whether the one before was 0.
_CONTEXTS = 2


@dataclass(frozen=True, slots=True)
class TimesPacket:
    """The times of up to `MAX_TIMED_FRAMES` source frames.

    first_frame: the source frame of the first.
    ticks: deviation of each from its time at the constant rate; from one to the next it changes by
        at most `MAX_TICK_STEP`.
    """

    sequence: int
    first_frame: int
    ticks: tuple[int, ...]

    def __post_init__(self) -> None:
        check_int("sequence", self.sequence, 0, SEQUENCE_MODULUS - 1)
        check_int("first frame", self.first_frame, 0, MAX_FRAME_INDEX)
        check_int("number of times", len(self.ticks), 1, MAX_TIMED_FRAMES)
        check_int("time", self.ticks[0], -MAX_TICKS, MAX_TICKS)
        for before, after in pairwise(self.ticks):
            check_int("change of a time", after - before, -MAX_TICK_STEP, MAX_TICK_STEP)


def serialise_times(packet: TimesPacket) -> bytes:
    """The payload after the event: first frame, first time, then a range coder."""
    first = packet.ticks[0]
    head = encode_varint(packet.first_frame) + encode_varint(2 * abs(first) - (first < 0))
    coder = RangeEncoder()
    code_bits(coder, len(packet.ticks) - 1, _COUNT_BITS)
    integers, before = AdaptiveIntegers(_CONTEXTS), 0
    for left, right in pairwise(packet.ticks):
        before = integers.code(coder, int(before != 0), right - left)
    return head + coder.finish()


def parse_times(sequence: int, data: bytes) -> TimesPacket:
    """The inverse of `serialise_times`.  Raises `ValueError` if `data` is not one's encoding."""
    first_frame, start = decode_varint(data)
    code, length = decode_varint(data[start:])
    coder = RangeDecoder(data[start + length :])
    ticks = [-(code + 1) // 2 if code % 2 else code // 2]
    integers, before = AdaptiveIntegers(_CONTEXTS), 0
    for _ in range(code_bits(coder, 0, _COUNT_BITS)):
        before = integers.code(coder, int(before != 0), 0)
        ticks.append(ticks[-1] + before)
    packet = TimesPacket(sequence, first_frame, tuple(ticks))
    if serialise_times(packet) != data:
        raise ValueError("times are not in their shortest encoding")
    return packet


class FrameClock:
    """Tells when source frames are shown, from the times packets of a call.

    Frames are asked for in order.  One whose times packet is missing has the deviation of the
    newest frame before it whose time is known.
    is_constant: no times have come yet: the source has a constant frame rate.
    """

    def __init__(self) -> None:
        self.is_constant = True
        self._ticks: dict[int, int] = {}
        self._deviation = 0

    def receive(self, packet: TimesPacket) -> None:
        """Enter the times of a packet."""
        self.is_constant = False
        self._ticks.update(enumerate(packet.ticks, packet.first_frame))

    def time_s(self, frame: int, fps: Fraction) -> Fraction:
        """The time of source frame `frame`, seconds from the start of the source.

        fps: frame rate of the call.
        """
        for known in sorted(index for index in self._ticks if index <= frame):
            self._deviation = self._ticks.pop(known)
        return (frame + Fraction(self._deviation, TICKS_PER_FRAME)) / fps
