"""Which integers to send: rate-distortion optimised quantisation of one packet's frames.

Components are scaled so that one unit of any of them does equal harm to the picture; the distortion of
a packet is then the plain sum of squares, and a value is worth its bits or it is not.
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
    reconstruct,
    step,
    value_bits,
)

Array = NDArray[np.float64]

# Lagrangian, in squared steps per bit.
WORTH = 0.11
_BITS = value_bits()


@dataclass(frozen=True, slots=True)
class CodedPacket:
    """A packet ready to be sent, and what it leaves behind.

    payload: bytes.  frames: (count, n) int64, as the decoder has them.
    """

    payload: bytes
    frames: Integers


def code_packet(
    predictor: FramePredictor, packet: int, usual_frames: int, targets: Array, quality: int
) -> CodedPacket:
    """Quantise and code the frames `targets` (count, n), in units; does not move the predictor.

    The activity that makes the packet shortest is chosen.
    """
    wanted = np.rint(targets * UNIT).astype(np.int64)
    best: CodedPacket | None = None
    for activity in range(4):
        head = PacketHead(quality, activity, len(wanted))
        values, known = _quantise(predictor, packet, wanted, head)
        payload = encode_packet(predictor, packet, usual_frames, head, values)
        if best is None or len(payload) < len(best.payload):
            frames = np.array([known[index] for index in range(1, len(wanted) + 1)])
            best = CodedPacket(payload, frames)
    assert best is not None
    return best


def _quantise(
    predictor: FramePredictor, packet: int, wanted: Integers, head: PacketHead
) -> tuple[list[tuple[Place, Integers]], dict[int, Integers]]:
    known = {0: predictor.anchor}
    values = []
    steps = np.array([step(head.quality, kind) for kind in range(KINDS)])
    for place in coding_order(len(wanted)):
        kinds = predictor.kinds(place, packet)
        error = wanted[place.index - 1] - predictor.predict(place, kinds, known)
        tables = predictor.tables(kinds, head.quality, head.activity)
        differences = _worthwhile(error / steps[kinds], tables)
        values.append((place, differences))
        known[place.index] = reconstruct(
            predictor, place, kinds, known, head.quality, differences
        )
    return values, known


def _worthwhile(error: Array, tables: Integers) -> Integers:
    """(n,) integers near `error` (n,), in steps, that minimise squared error + WORTH x bits."""
    size = np.abs(error)
    nearest = np.rint(size)
    choices = np.stack([nearest, np.maximum(nearest - 1, 0), np.zeros_like(nearest)])
    most = _BITS.shape[1] - 1
    bits = _BITS[tables, np.minimum(choices, most).astype(np.int64)]
    cost = (size - choices) ** 2 + WORTH * bits
    chosen = choices[cost.argmin(0), np.arange(len(size))]
    return (np.sign(error) * chosen).astype(np.int64)
