"""Which integers to send: rate-distortion optimised quantisation of one packet's frames.

Components are scaled so that one unit of any of them does equal harm to the picture; the distortion
of a packet is then the plain sum of squares, and a value is worth its bits or it is not.  Frames
are predicted from one another, so a value moves all that are found by it: values are chosen one
after another first, then again, each with all the others in sight.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from protocol.frames.temporal_prediction import (
    ANCHOR,
    KINDS,
    UNIT,
    FramePredictor,
    Integers,
    PacketHead,
    coding_order,
    encode_packet,
    interpolate,
    parents,
    reconstruct,
    step,
)
from protocol.frames.value_coding import MAX_SIZE, UNARY, Surroundings, tables_around, value_bits

Array = NDArray[np.float64]

# Lagrangian, in squared steps per bit: a value's own step at first, an anchor's when all are chosen
# again.
WORTH = 0.25
# How often all values of a packet are chosen again.
SWEEPS = 2
# A packet's last frame is what the next one's are predicted from: how much their errors count that
# are less than so many steps, and will hardly be mended.
AHEAD, CALM_STEPS = 0.5, 0.5
_BITS = value_bits()
_BITS_BY_TABLE = _BITS.tolist()
# Integer frames stand for fractions of this.
_WHOLE = 1 << 20


@dataclass(frozen=True, slots=True)
class CodedPacket:
    """A packet ready to be sent, and what it leaves behind.

    payload: bytes.  frames: (count, n) int64, as the decoder has them.
    """

    payload: bytes
    frames: Integers


def code_packet(
    predictor: FramePredictor,
    sequence: int,
    usual_frames: int,
    targets: Array,
    quality: int,
    fresh: bool = False,
    coming: Array | None = None,
) -> CodedPacket:
    """Quantise and code the frames `targets` (count, n), in units; does not move the predictor.

    coming: (m, n) the frames of the next packet, where they are known already.
    """
    wanted = _whole(targets)
    head = PacketHead(quality, len(wanted), fresh, _idle(predictor, wanted))
    packet = _Packet(predictor, sequence, head)
    values = packet.one_by_one(wanted)
    goal = _goal(wanted, quality, None if coming is None else _whole(coming))
    for _ in range(SWEEPS):
        packet.choose_again(values, goal)
    coded = list(zip(packet.order, values, strict=True))
    payload = encode_packet(predictor, sequence, usual_frames, head, coded)
    return CodedPacket(payload, packet.frames(values))


def _whole(frames: Array) -> Integers:
    return np.rint(frames * UNIT).astype(np.int64)


def _idle(predictor: FramePredictor, wanted: Integers) -> int:
    """How many of the last components do nothing before, in and after these frames."""
    used = np.abs(wanted).max(0) + np.abs(predictor.anchor)
    return min(predictor.spare, len(used) - 1 - int(np.flatnonzero(used).max(initial=-1)))


@dataclass(frozen=True, slots=True)
class _Goal:
    """What a packet's values should come near: its own frames, then those of the next packet.

    frames: (f, n), the latter less what the next packet itself adds to them.  weight: (f, n).
    reach: (f, places) what a value adds to each frame, in its steps.
    """

    frames: Array
    weight: Array
    reach: Array

    def error(self, found: Integers) -> Array:
        """(f, n) what is missing where the packet's frames (count, n) are `found`."""
        ahead = self.reach[len(found) :, :1]
        return np.asarray(self.frames - np.concatenate([found, ahead * found[-1]]))


class _Packet:
    """A packet whose values, (places, n) in steps, are to be chosen."""

    def __init__(self, predictor: FramePredictor, sequence: int, head: PacketHead) -> None:
        self.order = coding_order(head.frames)
        self._predictor, self._head = predictor, head
        self._used = predictor.components - head.idle
        self._kinds = [predictor.kinds(place, sequence, head.fresh) for place in self.order]
        by_kind = np.array([step(head.quality, kind) for kind in range(KINDS)])
        self._steps = by_kind[np.array(self._kinds)]
        self._tables = [
            predictor.tables(kinds, head.quality)[: self._used] for kinds in self._kinds
        ]

    def one_by_one(self, wanted: Integers) -> Integers:
        """Values for frames (count, n), each as if nothing were predicted from it."""
        known, sizes, surroundings = self._start(), dict[int, Integers](), Surroundings()
        values = np.zeros(self._steps.shape, np.int64)
        for place, kinds, steps, tables, row in zip(
            self.order, self._kinds, self._steps, self._tables, values, strict=True
        ):
            error = wanted[place.index - 1] - self._predictor.predict(place, kinds, known)
            around = parents(place, sizes)
            row[: self._used] = _worthwhile(
                (error / steps)[: self._used], tables, around, surroundings
            )
            sizes[place.index] = np.abs(row)
            known[place.index] = self._reconstructed(known, len(sizes) - 1, row)
        return values

    def choose_again(self, values: Integers, goal: _Goal) -> None:
        """Replace each of values (places, n) by what is best while the others stay.

        What it costs is counted by the tables that the values before gave.
        """
        error, used = goal.error(self.frames(values)), self._used
        worth = WORTH * step(self._head.quality, ANCHOR) ** 2
        prices = worth * _BITS[self._tables_around(values)]
        for row, steps, column, price in zip(
            values, self._steps, goal.reach.T, prices, strict=True
        ):
            moves = column[:, None] * steps
            pull = (goal.weight * moves * error).sum(0)[:used]
            stiffness = (goal.weight * moves**2).sum(0)[:used]
            before = row.copy()
            row[:used] = _cheapest(row[:used] + pull / stiffness, stiffness, price)
            error -= moves * (row - before)

    def frames(self, values: Integers) -> Integers:
        """(count, n) frames that values (places, n) make."""
        known = self._start()
        for number, row in enumerate(values):
            known[self.order[number].index] = self._reconstructed(known, number, row)
        return np.array([known[index] for index in range(1, len(values) + 1)])

    def _start(self) -> dict[int, Integers]:
        return {0: self._predictor.anchor}

    def _reconstructed(self, known: dict[int, Integers], number: int, row: Integers) -> Integers:
        place, kinds = self.order[number], self._kinds[number]
        return reconstruct(self._predictor, place, kinds, known, self._head.quality, row)

    def _tables_around(self, values: Integers) -> Integers:
        """(places, used) the table of each value, if these are all of them."""
        sizes = np.abs(values[:, : self._used])
        return tables_around(np.array(self._tables), _descent(self._head.frames) @ sizes, sizes)


@lru_cache
def _descent(count: int) -> Integers:
    """(places, places) 1 where a place of a packet is predicted from another one, see `parents`."""
    found, sizes = np.zeros((count, count), np.int64), dict[int, Integers]()
    for place, row, itself in zip(
        coding_order(count), found, np.eye(count, dtype=np.int64), strict=True
    ):
        around = parents(place, sizes)
        row[:] = 0 if around is None else around
        sizes[place.index] = itself
    return found


def _goal(wanted: Integers, quality: int, coming: Integers | None) -> _Goal:
    """The goal of a packet of frames (count, n), followed by frames (m, n) if these are known."""
    reach, weight = _reach(len(wanted)), np.ones(wanted.shape)
    if coming is None:
        return _Goal(wanted.astype(np.float64), weight, reach)
    last, count = wanted[-1], len(coming)
    left = coming[:-1] - _between(last, coming[-1], count)
    steps = np.array([step(quality, kind) for kind in _kinds_between(count)])[:, None]
    calm = np.abs(left) < CALM_STEPS * steps
    ahead = np.zeros((count - 1, len(wanted)))
    ahead[:, 0] = _between(np.array([_WHOLE]), np.array([0]), count)[:, 0] / _WHOLE
    return _Goal(
        np.concatenate([wanted, left + ahead[:, :1] * last]),
        np.concatenate([weight, AHEAD * calm]),
        np.concatenate([reach, ahead]),
    )


@lru_cache
def _reach(count: int) -> Array:
    """(count, places) what one step of each value adds to each frame of a packet, in steps."""
    known: dict[int, Integers] = {0: np.zeros(count, np.int64)}
    for place, itself in zip(
        coding_order(count), _WHOLE * np.eye(count, dtype=np.int64), strict=True
    ):
        found = known[0] if place.kind == ANCHOR else interpolate(place, known)
        known[place.index] = found + itself
    return np.array([known[index] for index in range(1, count + 1)]) / _WHOLE


def _between(first: Integers, last: Integers, count: int) -> Integers:
    """(count - 1, n) frames between `first` and `last`, `count` later, that no value mends."""
    known = {0: first, count: last}
    for place in coding_order(count)[1:]:
        known[place.index] = interpolate(place, known)
    return np.array([known[index] for index in range(1, count)]).reshape(count - 1, len(first))


def _kinds_between(count: int) -> list[int]:
    """How each of the frames before the last of a packet is predicted."""
    kinds = {place.index: place.kind for place in coding_order(count)}
    return [kinds[index] for index in range(1, count)]


def _cheapest(best: Array, stiffness: Array, price: Array) -> Integers:
    """(k,) integers of least `stiffness` x squared distance from `best` + price of their size.

    price: (k, UNARY + 1).
    """
    every = np.arange(len(best))
    choices = np.zeros((3, len(best)))
    choices[0] = np.minimum(np.maximum(np.floor(best), -MAX_SIZE), MAX_SIZE - 1)
    choices[1] = choices[0] + 1
    sizes = np.minimum(np.abs(choices), UNARY).astype(np.intp)
    cost = stiffness * (choices - best) ** 2 + price[every, sizes]
    return np.asarray(choices[cost.argmin(0), every], np.int64)


def _worthwhile(
    error: Array, tables: Integers, around: Integers | None, surroundings: Surroundings
) -> Integers:
    """(n,) integers near `error` (n,), in steps, that minimise squared error + WORTH x bits."""
    surroundings.start_frame()
    chosen = []
    for size, expected, parent in zip(
        np.abs(error).tolist(), tables.tolist(), _sums(around, len(tables)), strict=True
    ):
        best = min(round(size), MAX_SIZE)
        if best:
            bits = _BITS_BY_TABLE[surroundings.table(expected, parent)]
            best = min(
                (best, best - 1, 0),
                key=lambda choice: (size - choice) ** 2 + WORTH * bits[min(choice, UNARY)],
            )
        surroundings.saw(expected, best)
        chosen.append(best)
    return np.asarray(np.sign(error) * chosen, dtype=np.int64)


def _sums(around: Integers | None, count: int) -> list[int]:
    return [0] * count if around is None else around[:count].tolist()
