"""Which integers to send: rate-distortion optimised quantisation of one packet's frames.

Components are scaled so that one unit of any of them does equal harm to the picture; the distortion
of a packet is then the plain sum of squares, and a value is worth its bits or it is not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.predict import (
    KINDS,
    UNIT,
    FramePredictor,
    Integers,
    PacketHead,
    Place,
    coding_order,
    encode_packet,
    parents,
    reconstruct,
    step,
)
from protocol.values import MAX_SIZE, UNARY, Surroundings, value_bits

Array = NDArray[np.float64]

# Lagrangian, in squared steps per bit.
WORTH = 0.11
_BITS = value_bits().tolist()


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
) -> CodedPacket:
    """Quantise and code the frames `targets` (count, n), in units; does not move the predictor."""
    wanted = np.rint(targets * UNIT).astype(np.int64)
    head = PacketHead(quality, len(wanted), fresh, _idle(predictor, wanted))
    values, known = _quantise(predictor, sequence, wanted, head)
    payload = encode_packet(predictor, sequence, usual_frames, head, values)
    frames = np.array([known[index] for index in range(1, len(wanted) + 1)])
    return CodedPacket(payload, frames)


def _idle(predictor: FramePredictor, wanted: Integers) -> int:
    """How many of the last components do nothing before, in and after these frames."""
    used = np.abs(wanted).max(0) + np.abs(predictor.anchor)
    return min(predictor.spare, len(used) - 1 - int(np.flatnonzero(used).max(initial=-1)))


def _quantise(
    predictor: FramePredictor, sequence: int, wanted: Integers, head: PacketHead
) -> tuple[list[tuple[Place, Integers]], dict[int, Integers]]:
    known = {0: predictor.anchor}
    values, sizes, surroundings = [], dict[int, Integers](), Surroundings()
    steps = np.array([step(head.quality, kind) for kind in range(KINDS)])
    for place in coding_order(len(wanted)):
        kinds = predictor.kinds(place, sequence, head.fresh)
        error = wanted[place.index - 1] - predictor.predict(place, kinds, known)
        tables = predictor.tables(kinds, head.quality)
        around = parents(place, sizes)
        differences = np.zeros(predictor.components, np.int64)
        used = len(differences) - head.idle
        differences[:used] = _worthwhile(
            (error / steps[kinds])[:used], tables[:used], around, surroundings
        )
        values.append((place, differences))
        sizes[place.index] = np.abs(differences)
        known[place.index] = reconstruct(predictor, place, kinds, known, head.quality, differences)
    return values, known


def _worthwhile(
    error: Array, tables: Integers, around: Integers | None, surroundings: Surroundings
) -> Integers:
    """(n,) integers near `error` (n,), in steps, that minimise squared error + WORTH x bits."""
    surroundings.start_frame()
    sums = [0] * len(tables) if around is None else around[: len(tables)].tolist()
    chosen = []
    for size, expected, parent in zip(np.abs(error).tolist(), tables.tolist(), sums, strict=True):
        bits = _BITS[surroundings.table(expected, parent)]
        nearest = min(round(size), MAX_SIZE)
        best = min(
            (nearest, max(nearest - 1, 0), 0),
            key=lambda choice: (size - choice) ** 2 + WORTH * bits[min(choice, UNARY)],
        )
        surroundings.saw(expected, best)
        chosen.append(best)
    return np.asarray(np.sign(error) * chosen, dtype=np.int64)
