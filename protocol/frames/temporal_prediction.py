"""Frame packets of the default profile: integers predicted from the decoder's own past.

A packet holds the frames after an *anchor*, the last frame of the packet before.  Its own last
frame, the next anchor, is predicted from that one, damped; then the frame between two known ones
from these, and so on by halves (hierarchical prediction).  In turn, every component of an
anchor is coded without prediction once in `REFRESH` packets: a lost packet is forgotten without a
burst.

Each packet can be decoded whatever happened before it: probabilities depend on nothing but the
model packet's table of spreads and what the packet itself has shown so far.  All is integer, in
units of 1 / `UNIT` of a component's own unit; encoder and decoder run the same code.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.range_coder import WHOLE, RangeDecoder, RangeEncoder
from protocol.frames.value_coding import (
    LOWEST_TABLE,
    TABLES,
    BitCoder,
    Surroundings,
    code_bits,
    code_value,
)
from protocol.packets import ProtocolError

Integers = NDArray[np.int64]

UNIT = 256
REFRESH = 3
# How a component of a frame is predicted: not at all, from the anchor, or between two frames after
# one, two, or three and more halvings of the packet.
ABSOLUTE, ANCHOR = 0, 1
KINDS = 5
# Coarser steps the deeper the prediction, quarter octaves: errors of anchors spread, others do not.
_KIND_STEP = (0, 0, 1, 3, 4)
_QUARTERS = (64, 76, 91, 108)
# What of an anchor is left in the next one, in sixteenths, and by how many quarter octaves this
# prediction is better than holding the anchor, for a component whose anchors differ by 2 ** (d / 4)
# times its own usual size, d = -7, -6, ... 2: in an autoregressive process, 1 - 2 ** (d / 2) / 2.
_DAMPING = (16, 15, 15, 14, 13, 12, 10, 8, 5, 0)
_DAMPING_GAIN = (0, 0, 0, 0, 0, 0, 1, 1, 1, 2)

MAX_SPREAD = 63
# From a spread to the table of its values at quality 0: 1/16 unit is 8 quarter octaves below the
# finest step.
_SPREAD_OFFSET = 8


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
    """The quantiser's step, in 1 / `UNIT`: 2 ** (quality / 4 - 2) units, more for deeper kinds."""
    quarters = quality + _KIND_STEP[kind]
    return _QUARTERS[quarters % 4] << quarters // 4


def interpolate(place: Place, known: Mapping[int, Integers]) -> Integers:
    """(n,) the frame at `place`, no anchor, between the `known` frames around it.

    Half way it lies on a cubic through four of them; elsewhere, in packets of unusual length, the
    same bend is added.  Motion goes straight on beyond the two next to it where nothing is known.
    """
    span = place.right - place.left
    share = place.index - place.left
    left, right = known[place.left], known[place.right]
    before = known.get(place.left - span, 2 * left - right)
    after = known.get(place.right + span, 2 * right - left)
    straight = left * (span - share) + right * share
    return (16 * straight + span * (left + right - before - after)) // (16 * span)


class FramePredictor:
    """What both ends know of the past.

    spreads: (n, KINDS) integers 0..MAX_SPREAD: log2 of the usual size of each component's values,
        by kind of prediction, in quarter octaves above 1/16 unit; for anchors, of what they differ.
    spare: so many of the last components are not yet in use at first: packets say how many are.
    """

    def __init__(self, spreads: NDArray[Any], spare: int = 0) -> None:
        self.spreads = np.array(spreads, dtype=np.int64)
        self.components, self.spare = len(self.spreads), spare
        relative = self.spreads[:, ANCHOR] - self.spreads[:, ABSOLUTE]
        row = np.clip(relative + 7, 0, len(_DAMPING) - 1)
        self._damping = np.array(_DAMPING)[row]
        self.spreads[:, ANCHOR] = np.maximum(
            0, self.spreads[:, ANCHOR] - np.array(_DAMPING_GAIN)[row]
        )
        self.anchor = np.zeros(self.components, dtype=np.int64)

    def kinds(self, place: Place, sequence: int, fresh: bool) -> Integers:
        """(n,) kind of prediction of each component at `place` of packet `sequence`."""
        kinds = np.full(self.components, place.kind, dtype=np.int64)
        if place.kind == ANCHOR:
            refreshed = np.arange(self.components) % REFRESH == sequence % REFRESH
            kinds[refreshed | fresh] = ABSOLUTE
        return kinds

    def predict(self, place: Place, kinds: Integers, known: dict[int, Integers]) -> Integers:
        """(n,) prediction of the frame at `place` from the `known` frames of its packet."""
        if place.kind == ANCHOR:
            return np.where(kinds == ABSOLUTE, 0, known[0] * self._damping >> 4)
        return interpolate(place, known)

    def tables(self, kinds: Integers, quality: int) -> Integers:
        """(n,) table of each component before its surroundings are known, see `values`."""
        finer = self.spreads[np.arange(self.components), kinds] - _SPREAD_OFFSET - quality
        index = finer - np.array(_KIND_STEP)[kinds]
        return np.asarray(np.clip(index - LOWEST_TABLE, 0, TABLES - 1))


@dataclass(frozen=True, slots=True)
class PacketHead:
    """How a packet is coded: quality 0 (finest) to 31, number of frames.

    fresh: nothing in it is predicted from packets before.
    idle: so many of the last components are not in it: nothing is added to their predictions.
    """

    quality: int
    frames: int
    fresh: bool = False
    idle: int = 0


@dataclass(frozen=True, slots=True)
class ReadPacket:
    """A frame packet taken apart: what `encode_packet` was given, and the frames (n,) it makes."""

    head: PacketHead
    values: list[tuple[Place, Integers]]
    frames: list[Integers]


def encode_packet(
    predictor: FramePredictor,
    sequence: int,
    usual_frames: int,
    head: PacketHead,
    values: Sequence[tuple[Place, Integers]],
) -> bytes:
    """Payload of the frame packet numbered `sequence` (0..63).

    usual_frames: frames in a packet unless it says otherwise.
    values: quantised differences (n,) at each place, in coding order.
    """
    coder = RangeEncoder()
    for _ in encoding(coder, predictor, sequence, usual_frames, head, values):
        pass
    return coder.finish()


def encoding(
    coder: BitCoder,
    predictor: FramePredictor,
    sequence: int,
    usual_frames: int,
    head: PacketHead,
    values: Sequence[tuple[Place, Integers]],
) -> Iterator[int | None]:
    """Code a packet step by step, see `encode_packet`: its head (None), then each component."""
    _code_head(coder, head, usual_frames, predictor.spare)
    yield None
    surroundings, sizes = Surroundings(), dict[int, Integers]()
    for place, differences in values:
        kinds = predictor.kinds(place, sequence, head.fresh)
        tables = predictor.tables(kinds, head.quality)[: len(kinds) - head.idle]
        around = parents(place, sizes)
        used = differences[: len(tables)]
        coded = _coded_values(coder, surroundings, tables, around, used)
        yield from (component for component, _ in enumerate(coded))
        sizes[place.index] = np.abs(differences)


def decode_packet(
    predictor: FramePredictor, sequence: int, usual_frames: int, payload: bytes
) -> list[Integers]:
    """The frames, (n,) each, of a payload; the last becomes the predictor's anchor.

    Raises `ProtocolError` if the payload is not what an encoder makes.
    """
    packet = read_packet(predictor, sequence, usual_frames, payload)
    predictor.anchor = packet.frames[-1]
    return packet.frames


def read_packet(
    predictor: FramePredictor, sequence: int, usual_frames: int, payload: bytes
) -> ReadPacket:
    """What is in a payload, see `decode_packet`; does not move the predictor."""
    coder = RangeDecoder(payload)
    try:
        head = _code_head(coder, PacketHead(0, usual_frames), usual_frames, predictor.spare)
        values, known = _decode_frames(coder, predictor, sequence, head)
    except ValueError as error:
        raise ProtocolError(f"frame packet: {error}") from error
    if coder.surplus:
        raise ProtocolError(f"frame packet: {coder.surplus} bytes too many")
    return ReadPacket(head, values, [known[index] for index in range(1, head.frames + 1)])


def parents(place: Place, sizes: dict[int, Integers]) -> Integers | None:
    """(n,) sum of the `sizes` of the frames that `place` is between; None for an anchor."""
    if place.kind == ANCHOR:
        return None
    return sizes[place.right] + sizes.get(place.left, 0)


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


_USUAL = WHOLE - 512
_QUALITY_BITS = 5
_COUNT_BITS = 6


def _code_head(coder: BitCoder, head: PacketHead, usual_frames: int, spare: int) -> PacketHead:
    quality = code_bits(coder, head.quality, _QUALITY_BITS)
    fresh = coder.code_bit(int(head.fresh), _USUAL)
    frames = usual_frames
    if coder.code_bit(int(head.frames != usual_frames), _USUAL):
        frames = code_bits(coder, head.frames - 1, _COUNT_BITS) + 1
    if frames > usual_frames:
        raise ValueError(f"{frames} frames, limit {usual_frames}")
    idle = code_bits(coder, head.idle, spare.bit_length())
    if idle > spare:
        raise ValueError(f"{idle} components idle, limit {spare}")
    return PacketHead(quality, frames, bool(fresh), idle)


def _coded_values(
    coder: BitCoder,
    surroundings: Surroundings,
    tables: Integers,
    sizes: Integers | None,
    differences: Integers,
) -> Iterator[int]:
    surroundings.start_frame()
    around = [0] * len(tables) if sizes is None else sizes[: len(tables)].tolist()
    for value, expected, parent in zip(differences.tolist(), tables.tolist(), around, strict=True):
        value = code_value(coder, value, surroundings.table(expected, parent))
        surroundings.saw(expected, abs(value))
        yield value


def _decode_frames(
    coder: BitCoder, predictor: FramePredictor, sequence: int, head: PacketHead
) -> tuple[list[tuple[Place, Integers]], dict[int, Integers]]:
    values, known, sizes = [], {0: predictor.anchor}, dict[int, Integers]()
    surroundings, nothing = Surroundings(), np.zeros(predictor.components, dtype=np.int64)
    for place in coding_order(head.frames):
        kinds = predictor.kinds(place, sequence, head.fresh)
        tables = predictor.tables(kinds, head.quality)[: len(kinds) - head.idle]
        around = parents(place, sizes)
        coded = nothing.copy()
        used = coded[: len(tables)]
        used[:] = list(_coded_values(coder, surroundings, tables, around, used))
        values.append((place, coded))
        sizes[place.index] = np.abs(coded)
        known[place.index] = reconstruct(predictor, place, kinds, known, head.quality, coded)
    return values, known
