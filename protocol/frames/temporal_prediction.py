"""Temporal prediction of the default profile's frames, in integers.

A frame packet holds the frames after an *anchor*, the last frame of the packet before.  Its own
last frame, the next anchor, is predicted from that one with damping (leaky prediction).  The other
frames are predicted between two decoded ones, by halving (hierarchical prediction).  Each component
of the anchor is coded without prediction once in `REFRESH_PERIOD` packets, in turn (cyclic intra
refresh), so the effect of a lost packet ends without a burst of bits.

Values are in 1 / `STEPS_PER_UNIT` of a component's unit; encoder and decoder run the same code.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.frames.value_coding import LOWEST_TABLE, TABLES
from shared_model.arrays import Integers

STEPS_PER_UNIT = 256
REFRESH_PERIOD = 3
# Kinds of prediction of a component: none, from the anchor, or between two frames after one, two,
# or three and more halvings of the packet.
INTRA, ANCHOR = 0, 1
PREDICTION_KINDS = 5
# Quarter octaves by which the step of each kind is coarser: fewer frames are predicted from the
# frames of later kinds.
_KIND_STEP = (0, 0, 1, 3, 4)
_QUARTERS = (64, 76, 91, 108)
# By d = scale code of ANCHOR - scale code of INTRA, d = -7, -6, ... 2 (anchors that differ by
# 2 ** (d / 4) of the component's own scale): the share of the anchor in the prediction of the next,
# in sixteenths, and the quarter octaves by which damping reduces the scale.  In an autoregressive
# process that share is 1 - 2 ** (d / 2) / 2.
_DAMPING = (16, 15, 15, 14, 13, 12, 10, 8, 5, 0)
_DAMPING_GAIN = (0, 0, 0, 0, 0, 0, 1, 1, 1, 2)

MAX_SCALE_CODE = 63
# Scale code 0 stands for 1/16 unit, 8 quarter octaves below the step of quality 0.
_SCALE_CODE_OFFSET = 8
# With values of this magnitude the products of the prediction fit into 64 bits.
MAX_VALUE = 1 << 40


@dataclass(frozen=True, slots=True)
class CodedFrame:
    """Frame `index` of a packet and what predicts it.

    index: from 1, the first frame after the anchor.
    left, right: indices of the two reference frames; 0 is the anchor of the packet before.
    kind: of prediction, `ANCHOR`..`PREDICTION_KINDS` - 1.
    """

    index: int
    left: int
    right: int
    kind: int


def coding_order(count: int) -> tuple[CodedFrame, ...]:
    """The `count` frames of a packet in the order in which they are coded."""
    order = [CodedFrame(count, 0, 0, ANCHOR)]
    waiting = [(0, count, ANCHOR + 1)]
    while waiting:
        left, right, kind = waiting.pop(0)
        if right - left > 1:
            middle = (left + right) // 2
            order.append(CodedFrame(middle, left, right, min(kind, PREDICTION_KINDS - 1)))
            waiting += [(left, middle, kind + 1), (middle, right, kind + 1)]
    return tuple(order)


def step(quality: int, kind: int) -> int:
    """The quantiser's step, in 1 / `STEPS_PER_UNIT`.

    2 ** (quality / 4 - 2) units, times 2 ** (1 / 4) for each of the kind's quarter octaves.
    """
    quarters = quality + _KIND_STEP[kind]
    return _QUARTERS[quarters % 4] << quarters // 4


def interpolate(frame: CodedFrame, decoded: Mapping[int, Integers]) -> Integers:
    """(n,) prediction of a frame between its references.

    decoded: frames (n,) of the packet by index.
    The prediction of the middle frame lies on the cubic through four equidistant frames; a frame
    off the middle has the same second difference added.  A frame that is not yet decoded is
    extrapolated linearly from the two references.
    """
    span = frame.right - frame.left
    offset = frame.index - frame.left
    left, right = decoded[frame.left], decoded[frame.right]
    before = decoded.get(frame.left - span, 2 * left - right)
    after = decoded.get(frame.right + span, 2 * right - left)
    straight = left * (span - offset) + right * offset
    return (16 * straight + span * (left + right - before - after)) // (16 * span)


class FramePredictor:
    """The state of temporal prediction that both ends share.

    scale_codes: (n, PREDICTION_KINDS) integers 0..MAX_SCALE_CODE: log2 of the Laplacian scale of
        each component's residuals by kind of prediction, in quarter octaves above 1/16 unit; of
        kind `ANCHOR`, the scale of the difference of successive anchors.
    reserved: so many of the last components may be unused; packets say how many are.

    Attribute anchor: (n,) the last frame of the packet before.
    """

    def __init__(self, scale_codes: NDArray[Any], reserved: int = 0) -> None:
        self.scale_codes = np.array(scale_codes, dtype=np.int64)
        self.component_count, self.reserved = len(self.scale_codes), reserved
        relative = self.scale_codes[:, ANCHOR] - self.scale_codes[:, INTRA]
        row = np.clip(relative + 7, 0, len(_DAMPING) - 1)
        self._damping = np.array(_DAMPING)[row]
        self.scale_codes[:, ANCHOR] = np.maximum(
            0, self.scale_codes[:, ANCHOR] - np.array(_DAMPING_GAIN)[row]
        )
        self.anchor = np.zeros(self.component_count, dtype=np.int64)

    def kinds(self, frame: CodedFrame, sequence: int, intra: bool) -> Integers:
        """(n,) kind of prediction of each component of `frame` in packet `sequence`.

        intra: nothing in the packet is predicted from the packet before.
        """
        kinds = np.full(self.component_count, frame.kind, dtype=np.int64)
        if frame.kind == ANCHOR:
            phase = np.arange(self.component_count) % REFRESH_PERIOD
            kinds[(phase == sequence % REFRESH_PERIOD) | intra] = INTRA
        return kinds

    def predict(self, frame: CodedFrame, kinds: Integers, decoded: dict[int, Integers]) -> Integers:
        """(n,) prediction of `frame` from the `decoded` frames (n,) of its packet, by index."""
        if frame.kind == ANCHOR:
            return np.where(kinds == INTRA, 0, decoded[0] * self._damping >> 4)
        return interpolate(frame, decoded)

    def base_tables(self, kinds: Integers, quality: int) -> Integers:
        """(n,) table of each component without context, see `value_coding.ValueContext`."""
        scales = self.scale_codes[np.arange(self.component_count), kinds]
        index = scales - _SCALE_CODE_OFFSET - quality - np.array(_KIND_STEP)[kinds]
        return np.asarray(np.clip(index - LOWEST_TABLE, 0, TABLES - 1))


def reference_magnitudes(frame: CodedFrame, magnitudes: dict[int, Integers]) -> Integers | None:
    """(n,) sum of the residual magnitudes of a frame's references; None for an anchor.

    magnitudes: (n,) of the coded frames of the packet, by index.
    """
    if frame.kind == ANCHOR:
        return None
    return magnitudes[frame.right] + magnitudes.get(frame.left, 0)


def reconstruct(
    predictor: FramePredictor,
    frame: CodedFrame,
    kinds: Integers,
    decoded: dict[int, Integers],
    quality: int,
    residuals: Integers,
) -> Integers:
    """(n,) `frame` from its quantised prediction residuals (n,)."""
    steps = np.array([step(quality, kind) for kind in range(PREDICTION_KINDS)])[kinds]
    values = predictor.predict(frame, kinds, decoded) + residuals * steps
    return np.asarray(np.clip(values, -MAX_VALUE, MAX_VALUE))
