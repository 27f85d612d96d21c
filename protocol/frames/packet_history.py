"""Decoding of frame packets of which some come late or never.

A packet is decoded from the anchor that the one before has left, or, where that one is missing, the
newest there is.  When it comes after all, it and those after it are decoded again, so the newest
anchor is exact.  Guessing the anchor of a missing packet from those around it gains .1 dB where
nothing is repeated, and nothing otherwise.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

from protocol.frames.payload_coding import parse_payload
from protocol.frames.temporal_prediction import FramePredictor
from protocol.limits import SEQUENCE_MODULUS
from shared_model.arrays import Integers

# Packets that are kept: 2.6 s at 8 frames a packet and 25 a second.
KEPT_PACKETS = 8


@dataclass(frozen=True, slots=True)
class _Decoded:
    """A packet and what was decoded from it: `frames` (n,), in order of time."""

    number: int
    payload: bytes
    frames: list[Integers]


class PacketHistory:
    """Decodes the packets of one model; keeps the newest `KEPT_PACKETS` of them.

    nominal_frames: frames in a packet whose header states no other number.
    """

    def __init__(self, predictor: FramePredictor, nominal_frames: int) -> None:
        self._predictor, self._nominal = predictor, nominal_frames
        self._kept: list[_Decoded] = []
        self._first_anchor = predictor.anchor  # before the oldest of those kept

    def decode(self, number: int, payload: bytes) -> list[Integers]:
        """The frames (n,) of packet `number` (0 is the model's first), later than all before.

        Raises `ProtocolError` if no encoder makes the payload.
        """
        decoded = self._decoded(self._kept, number, payload)
        self._keep([*self._kept, decoded])
        return decoded.frames

    def insert(self, number: int, payload: bytes) -> list[Integers] | None:
        """Decode a late packet and all after it again; returns the frames (n,) of the newest one.

        None: the packet is there already, or is older than those kept.
        Raises `ProtocolError` if no encoder makes the payload.
        """
        place = bisect_left(self._kept, number, key=lambda each: each.number)
        is_known = place < len(self._kept) and self._kept[place].number == number
        if is_known or (not place and len(self._kept) == KEPT_PACKETS):
            return None
        chain = [*self._kept[:place], self._decoded(self._kept[:place], number, payload)]
        for later in self._kept[place:]:
            chain.append(self._decoded(chain, later.number, later.payload))
        self._keep(chain)
        return chain[-1].frames

    def _keep(self, chain: list[_Decoded]) -> None:
        for oldest in chain[:-KEPT_PACKETS]:
            self._first_anchor = oldest.frames[-1]
        self._kept = chain[-KEPT_PACKETS:]

    def _decoded(self, before: Sequence[_Decoded], number: int, payload: bytes) -> _Decoded:
        self._predictor.anchor = before[-1].frames[-1] if before else self._first_anchor
        sequence = number % SEQUENCE_MODULUS
        parsed = parse_payload(self._predictor, sequence, self._nominal, payload)
        return _Decoded(number, payload, parsed.frames)
