"""Frame packets of the default profile: integers predicted from the decoder's own past, range coded.

A packet holds the frames after an *anchor*, the last frame of the packet before.  Its own last frame,
the next anchor, is predicted from that anchor; then the frame in the middle of two known ones from
their mean, and so on by halves (hierarchical prediction).  In turn, every component of an anchor is
coded without prediction once in `REFRESH` packets, so that a lost packet is forgotten without a burst.

Each packet can be decoded whatever happened before it: probabilities depend on nothing but the model
packet's table of spreads and two small numbers in the packet's head.  Everything here is integer, in
units of 1 / `UNIT` of a component's own unit; encoder and decoder run the same code.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.entropy import WHOLE, RangeDecoder, RangeEncoder
from protocol.messages import ProtocolError

Integers = NDArray[np.int64]

UNIT = 256
REFRESH = 3
# How a component of a frame is predicted: not at all, from the anchor, or between two frames that are
# 2, 4 or 8 and more of a packet's halvings apart.
ABSOLUTE, ANCHOR = 0, 1
KINDS = 5
# Coarser steps the deeper the prediction, quarter octaves: errors of anchors spread, others do not.
_KIND_STEP = (0, 0, 1, 3, 4)
_MAX_QUALITY = 31
_ACTIVITIES = (-4, 0, 4, 8)
_QUARTERS = (256, 304, 362, 431)

MAX_SPREAD = 63
_SPREAD_OFFSET = 16
_LOWEST = -20
# Probability, of 65536, that a value is zero, and that its size goes no further, for a Laplacian whose
# scale is 2 ** (k / 4) steps, k = -20, -19, ... 28.
_ZERO = (
    65488, 65488, 65488, 65488, 65488, 65488, 65462, 65319, 64997, 64378, 63336, 61761,
    59591, 56826, 53528, 49806, 45797, 41644, 37484, 33429, 29569, 25966, 22659, 19665,
    16986, 14612, 12527, 10707, 9129, 7766, 6595, 5592, 4735, 4006, 3385, 2858,
    2412, 2034, 1715, 1445, 1217, 1025, 863, 727, 612, 515, 433, 364,
    306,
)
_STOP = (
    65472, 65472, 65472, 65472, 65472, 65472, 65472, 65472, 65472, 65457, 65307, 64973,
    64336, 63268, 61662, 59461, 56667, 53344, 49603, 45583, 41427, 37269, 33222, 29374,
    25786, 22495, 19517, 16855, 14497, 12425, 10619, 9052, 7701, 6539, 5544, 4694,
    3971, 3355, 2833, 2391, 2016, 1700, 1432, 1207, 1016, 855, 720, 606,
    510,
)
_UNARY = 18
_ESCAPE_BITS = 15


@dataclass(frozen=True, slots=True)
class Place:
    """Where frame `index` (1 = the first after the anchor) of a packet is predicted from."""

    index: int
    left: int
    right: int
    kind: int


def coding_order(count: int) -> tuple[Place, ...]:
    """The order in which the `count` frames after an anchor (index 0) are coded."""
    order = [Place(count, 0, 0, ANCHOR)]
    waiting = [(0, count, ANCHOR + 1)]
    while waiting:
        left, right, kind = waiting.pop(0)
        if right - left > 1:
            middle = (left + right) // 2
            order.append(Place(middle, left, right, min(kind, KINDS - 1)))
            waiting += [(left, middle, kind + 1), (middle, right, kind + 1)]
    return tuple(order)


def step(quality: int, kind: int) -> int:
    """The quantiser's step, in 1 / `UNIT`: 2 ** (quality / 4) units, more for deeper kinds."""
    quarters = quality + _KIND_STEP[kind]
    return _QUARTERS[quarters % 4] << quarters // 4


class FramePredictor:
    """What both ends know of the past.

    spreads: (n, KINDS) integers 0..MAX_SPREAD: log2 of the usual size of each component's values, by
        kind of prediction, in quarter octaves above 1/16 unit.
    """

    def __init__(self, spreads: Integers) -> None:
        self.spreads = np.asarray(spreads, dtype=np.int64)
        self.components = len(self.spreads)
        self.anchor = np.zeros(self.components, dtype=np.int64)

    def kinds(self, place: Place, packet: int) -> Integers:
        """(n,) kind of prediction of each component at `place` of packet number `packet`."""
        kinds = np.full(self.components, place.kind, dtype=np.int64)
        if place.kind == ANCHOR:
            kinds[np.arange(self.components) % REFRESH == packet % REFRESH] = ABSOLUTE
        return kinds

    def predict(self, place: Place, kinds: Integers, known: dict[int, Integers]) -> Integers:
        """(n,) prediction of the frame at `place` from the `known` frames of its packet."""
        if place.kind == ANCHOR:
            return np.where(kinds == ABSOLUTE, 0, known[0])
        span = place.right - place.left
        share = place.index - place.left
        return (known[place.left] * (span - share) + known[place.right] * share) // span

    def tables(self, kinds: Integers, quality: int, activity: int) -> Integers:
        """(n,) place of each component in the probability tables."""
        finer = self.spreads[np.arange(self.components), kinds] - _SPREAD_OFFSET - quality
        index = finer - np.array(_KIND_STEP)[kinds] + _ACTIVITIES[activity]
        return np.clip(index - _LOWEST, 0, len(_ZERO) - 1)


@dataclass(frozen=True, slots=True)
class PacketHead:
    """How a packet is coded: quality 0 (finest) to 31, activity 0 to 3, number of frames."""

    quality: int
    activity: int
    frames: int


def encode_packet(
    predictor: FramePredictor,
    packet: int,
    usual_frames: int,
    head: PacketHead,
    values: Sequence[tuple[Place, Integers]],
) -> bytes:
    """Payload of frame packet number `packet`.

    usual_frames: frames in a packet unless it says otherwise.
    values: quantised differences (n,) at each place, in coding order.
    """
    coder = RangeEncoder()
    coder.encode_bits(head.quality, 5)
    coder.encode_bits(head.activity, 2)
    _encode_count(coder, head.frames, usual_frames)
    for place, differences in values:
        kinds = predictor.kinds(place, packet)
        index = predictor.tables(kinds, head.quality, head.activity)
        for value, table in zip(differences.tolist(), index.tolist(), strict=True):
            _encode_value(coder, value, table)
    return coder.finish()


def decode_packet(
    predictor: FramePredictor, packet: int, usual_frames: int, payload: bytes
) -> list[Integers]:
    """The frames, (n,) each, of a payload; the last becomes the predictor's anchor.

    Raises `ProtocolError` if the payload is not what an encoder makes.
    """
    coder = RangeDecoder(payload)
    quality, activity = coder.decode_bits(5), coder.decode_bits(2)
    frames = _decode_count(coder, usual_frames)
    known = {0: predictor.anchor}
    for place in coding_order(frames):
        kinds = predictor.kinds(place, packet)
        index = predictor.tables(kinds, quality, activity)
        differences = np.array([_decode_value(coder, table) for table in index.tolist()])
        known[place.index] = reconstruct(predictor, place, kinds, known, quality, differences)
    predictor.anchor = known[frames]
    return [known[index] for index in range(1, frames + 1)]


def reconstruct(
    predictor: FramePredictor,
    place: Place,
    kinds: Integers,
    known: dict[int, Integers],
    quality: int,
    differences: Integers,
) -> Integers:
    """(n,) the frame that differences (n,) at `place` stand for."""
    steps = np.array([step(quality, kind) for kind in range(KINDS)])[kinds]
    moved = predictor.predict(place, kinds, known) + differences * steps
    return np.asarray(np.clip(moved, -MAX_VALUE, MAX_VALUE))


# Values stay within what 64-bit products of the prediction hold, whatever the wire says.
MAX_VALUE = 1 << 40


def value_bits() -> NDArray[np.float64]:
    """(tables, sizes) bits that a value of each size up to `_UNARY` costs under each table."""
    zero, stop = np.array(_ZERO) / WHOLE, np.array(_STOP) / WHOLE
    sizes = np.arange(_UNARY)
    costs = np.empty((len(zero), _UNARY + 1))
    costs[:, 0] = -np.log2(zero)
    more = (1 - np.log2(1 - zero))[:, None] - sizes * np.log2(1 - stop)[:, None]
    costs[:, 1:] = more - np.log2(stop)[:, None]
    return costs


def _encode_value(coder: RangeEncoder, value: int, table: int) -> None:
    size = min(abs(value), (1 << _ESCAPE_BITS) - 1)
    coder.encode_bit(int(size > 0), _ZERO[table])
    if size == 0:
        return
    coder.encode_bit(int(value < 0), WHOLE // 2)
    for reached in range(1, _UNARY + 1):
        coder.encode_bit(int(size > reached), _STOP[table])
        if size == reached:
            return
    coder.encode_bits(size, _ESCAPE_BITS)


def _decode_value(coder: RangeDecoder, table: int) -> int:
    if not coder.decode_bit(_ZERO[table]):
        return 0
    sign = -1 if coder.decode_bit(WHOLE // 2) else 1
    for reached in range(1, _UNARY + 1):
        if not coder.decode_bit(_STOP[table]):
            return sign * reached
    return sign * coder.decode_bits(_ESCAPE_BITS)


_USUAL_COUNT = WHOLE - 512
_COUNT_BITS = 6


def _encode_count(coder: RangeEncoder, frames: int, usual: int) -> None:
    coder.encode_bit(int(frames != usual), _USUAL_COUNT)
    if frames != usual:
        coder.encode_bits(frames - 1, _COUNT_BITS)


def _decode_count(coder: RangeDecoder, usual: int) -> int:
    if not coder.decode_bit(_USUAL_COUNT):
        return usual
    frames = coder.decode_bits(_COUNT_BITS) + 1
    if frames > usual:
        raise ProtocolError(f"frame packet of {frames} frames, limit {usual}")
    return frames
