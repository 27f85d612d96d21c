"""Rate-distortion optimised quantisation (RDOQ) of a packet's frames.

Components are scaled to equal distortion, so that the distortion of a packet is a sum of squares.
Frames are predicted from one another, so that the error of a value propagates to all frames that
refer to it.  Values are first quantised in coding order, then by coordinate descent on the
distortion of the whole packet.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from encoder.coding.value_loops import new_context, round_adaptively, value_decisions
from encoder.picture_coding.symbol_writing import DecisionRecorder, range_coded
from protocol.frames.payload_coding import PayloadHeader, code_header
from protocol.frames.temporal_prediction import (
    ANCHOR,
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    FramePredictor,
    coding_order,
    interpolate,
    reconstruct,
    reference_magnitudes,
    step,
)
from protocol.frames.value_coding import (
    MAX_MAGNITUDE,
    UNARY_LIMIT,
    context_tables,
    value_bits,
)
from shared_model.arrays import Array, Integers

# Lagrangian, squared steps per bit: the steps of each value in coding order, the anchor's in the
# descent.
LAGRANGIAN = 0.25
# Iterations of coordinate descent.
ITERATIONS = 2
# Weight of the next packet's prediction errors, which depend on this packet's last frame.  Errors
# count that quantise to 0 there, that is, below so many steps.
NEXT_PACKET_WEIGHT, ZERO_BIN_STEPS = 0.5, 0.5
_BITS = value_bits()
# Fixed-point 1 of the integers of `interpolate`.
_ONE = 1 << 20


@dataclass(frozen=True, slots=True)
class CodedPacket:
    """The payload of a frame packet, and the decoded frames (count, n)."""

    payload: bytes
    frames: Integers


def code_packet(
    predictor: FramePredictor,
    sequence: int,
    nominal_frames: int,
    targets: Array,
    quality: int,
    intra: bool = False,
    next_targets: Array | None = None,
) -> CodedPacket:
    """Quantise and code frames (count, n), units; the predictor stays as it is.

    nominal_frames: frames of a usual packet.  quality: 0 (finest) to 31.
    intra: predict no value from an earlier packet.
    next_targets: (m, n) the frames of the next packet, if they are known.
    """
    frames = _fixed_point(targets)
    header = PayloadHeader(quality, len(frames), intra, _unused_tail(predictor, frames))
    quantiser = _PacketQuantiser(predictor, sequence, header)
    values = quantiser.quantise_sequentially(frames)
    next_frames = None if next_targets is None else _fixed_point(next_targets)
    target = _target(frames, quality, next_frames)
    for _ in range(ITERATIONS):
        quantiser.coordinate_descent(values, target)
    payload = quantiser.payload(values, nominal_frames)
    return CodedPacket(payload, quantiser.decoded(values))


def _fixed_point(frames: Array) -> Integers:
    return np.rint(frames * STEPS_PER_UNIT).astype(np.int64)


def _unused_tail(predictor: FramePredictor, frames: Integers) -> int:
    """The number of trailing reserved components that are 0 in the anchor and in all frames."""
    used = np.abs(frames).max(0) + np.abs(predictor.anchor)
    return min(predictor.reserved, len(used) - 1 - int(np.flatnonzero(used).max(initial=-1)))


@dataclass(frozen=True, slots=True)
class _Target:
    """The frames that a packet's values approximate: its own, then those of the next packet.

    frames: (f, n), those of the next packet without the next packet's own contribution.
    weight: (f, n) of squared errors.
    propagation: (f, count) what a value of each coded frame adds to each frame, in its steps.
    """

    frames: Array
    weight: Array
    propagation: Array

    def error(self, decoded: Integers) -> Array:
        """(f, n) remaining error for decoded frames (count, n) of the packet."""
        from_last = self.propagation[len(decoded) :, :1]
        return np.asarray(self.frames - np.concatenate([decoded, from_last * decoded[-1]]))


class _PacketQuantiser:
    """Chooses the values (count, n) of a packet, in quantiser steps and coding order."""

    def __init__(self, predictor: FramePredictor, sequence: int, header: PayloadHeader) -> None:
        self.order = coding_order(header.frames)
        self._predictor, self._header = predictor, header
        self._used = predictor.component_count - header.unused_components
        self._kinds = [predictor.kinds(coded, sequence, header.intra) for coded in self.order]
        by_kind = np.array([step(header.quality, kind) for kind in range(PREDICTION_KINDS)])
        self._steps = by_kind[np.array(self._kinds)]
        self._tables = [
            predictor.base_tables(kinds, header.quality)[: self._used] for kinds in self._kinds
        ]

    def quantise_sequentially(self, frames: Integers) -> Integers:
        """Values for frames (count, n), regardless of the frames that refer to them."""
        known, magnitudes, context = self._start(), dict[int, Integers](), new_context()
        values = np.zeros(self._steps.shape, np.int64)
        for coded, kinds, steps, tables, row in zip(
            self.order, self._kinds, self._steps, self._tables, values, strict=True
        ):
            error = frames[coded.index - 1] - self._predictor.predict(coded, kinds, known)
            references = reference_magnitudes(coded, magnitudes)
            wanted = (error / steps)[: self._used]
            sizes, sums = np.abs(wanted), np.zeros(len(wanted), np.int64)
            if references is not None:
                sums = references[: self._used]
            chosen = round_adaptively(sizes, tables, sums, _BITS, LAGRANGIAN, context)
            row[: self._used] = np.sign(wanted) * chosen
            magnitudes[coded.index] = np.abs(row)
            known[coded.index] = self._reconstructed(known, len(magnitudes) - 1, row)
        return values

    def coordinate_descent(self, values: Integers, target: _Target) -> None:
        """Optimise each row of values (count, n) in place while the other rows are fixed.

        Bits are those of the contexts of the initial values.
        """
        error, used = target.error(self.decoded(values)), self._used
        squared_steps_per_bit = LAGRANGIAN * step(self._header.quality, ANCHOR) ** 2
        rate_costs = squared_steps_per_bit * _BITS[self._context_tables(values)]
        for row, steps, column, rate_cost in zip(
            values, self._steps, target.propagation.T, rate_costs, strict=True
        ):
            effect = column[:, None] * steps
            gradient = (target.weight * effect * error).sum(0)[:used]
            curvature = (target.weight * effect**2).sum(0)[:used]
            before = row.copy()
            row[:used] = _rdo_round(row[:used] + gradient / curvature, curvature, rate_cost)
            error -= effect * (row - before)

    def payload(self, values: Integers, nominal_frames: int) -> bytes:
        """The payload of values (count, n), see `payload_coding.encode_payload`."""
        header = DecisionRecorder()
        code_header(header, self._header, nominal_frames, self._predictor.reserved)
        used = values[:, : self._used]
        references = _reference_matrix(self._header.frames) @ np.abs(used)
        of_values = value_decisions(used, np.array(self._tables), references)
        return range_coded([header.recorded(), of_values])

    def decoded(self, values: Integers) -> Integers:
        """The frames (count, n) that a decoder makes of values (count, n)."""
        known = self._start()
        for number, row in enumerate(values):
            known[self.order[number].index] = self._reconstructed(known, number, row)
        return np.array([known[index] for index in range(1, len(values) + 1)])

    def _start(self) -> dict[int, Integers]:
        return {0: self._predictor.anchor}

    def _reconstructed(self, known: dict[int, Integers], number: int, row: Integers) -> Integers:
        coded, kinds = self.order[number], self._kinds[number]
        return reconstruct(self._predictor, coded, kinds, known, self._header.quality, row)

    def _context_tables(self, values: Integers) -> Integers:
        """(count, used) the table of each value in the context of all others."""
        magnitudes = np.abs(values[:, : self._used])
        references = _reference_matrix(self._header.frames) @ magnitudes
        return context_tables(np.array(self._tables), references, magnitudes)


@lru_cache
def _reference_matrix(count: int) -> Integers:
    """(count, count) 1 where a coded frame refers to another, see `reference_magnitudes`."""
    matrix, magnitudes = np.zeros((count, count), np.int64), dict[int, Integers]()
    for coded, row, unit in zip(
        coding_order(count), matrix, np.eye(count, dtype=np.int64), strict=True
    ):
        references = reference_magnitudes(coded, magnitudes)
        row[:] = 0 if references is None else references
        magnitudes[coded.index] = unit
    return matrix


def _target(frames: Integers, quality: int, next_frames: Integers | None) -> _Target:
    """The target of a packet of frames (count, n) before frames (m, n), if these are known."""
    propagation, weight = _propagation(len(frames)), np.ones(frames.shape)
    if next_frames is None:
        return _Target(frames.astype(np.float64), weight, propagation)
    last, count = frames[-1], len(next_frames)
    error = next_frames[:-1] - _interpolated(last, next_frames[-1], count)
    steps = np.array([step(quality, kind) for kind in _kinds_inside(count)])[:, None]
    is_zero = np.abs(error) < ZERO_BIN_STEPS * steps
    from_last = np.zeros((count - 1, len(frames)))
    from_last[:, 0] = _interpolated(np.array([_ONE]), np.array([0]), count)[:, 0] / _ONE
    return _Target(
        np.concatenate([frames, error + from_last[:, :1] * last]),
        np.concatenate([weight, NEXT_PACKET_WEIGHT * is_zero]),
        np.concatenate([propagation, from_last]),
    )


@lru_cache
def _propagation(count: int) -> Array:
    """(count, count) what a step of each coded frame's value adds to each frame of a packet."""
    known: dict[int, Integers] = {0: np.zeros(count, np.int64)}
    for coded, unit in zip(coding_order(count), _ONE * np.eye(count, dtype=np.int64), strict=True):
        predicted = known[0] if coded.kind == ANCHOR else interpolate(coded, known)
        known[coded.index] = predicted + unit
    return np.array([known[index] for index in range(1, count + 1)]) / _ONE


def _interpolated(first: Integers, last: Integers, count: int) -> Integers:
    """The (count - 1, n) predictions between `first` and `last`, `count` frames later."""
    known = {0: first, count: last}
    for coded in coding_order(count)[1:]:
        known[coded.index] = interpolate(coded, known)
    return np.array([known[index] for index in range(1, count)]).reshape(count - 1, len(first))


def _kinds_inside(count: int) -> list[int]:
    """Prediction kinds of the frames of a packet before its last, in order of time."""
    kinds = {coded.index: coded.kind for coded in coding_order(count)}
    return [kinds[index] for index in range(1, count)]


def _rdo_round(optimum: Array, curvature: Array, rate_cost: Array) -> Integers:
    """(k,) integers of least `curvature` * (value - optimum) ** 2 + rate cost.

    rate_cost: (k, UNARY_LIMIT + 1) by magnitude.  Candidates are 0 and both neighbours.
    """
    each = np.arange(len(optimum))
    candidates = np.zeros((3, len(optimum)))
    candidates[0] = np.minimum(np.maximum(np.floor(optimum), -MAX_MAGNITUDE), MAX_MAGNITUDE - 1)
    candidates[1] = candidates[0] + 1
    magnitudes = np.minimum(np.abs(candidates), UNARY_LIMIT).astype(np.intp)
    cost = curvature * (candidates - optimum) ** 2 + rate_cost[each, magnitudes]
    return np.asarray(candidates[cost.argmin(0), each], np.int64)
