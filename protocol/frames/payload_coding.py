"""Payloads of the default profile's frame packets: a header, then the residuals of each frame.

The probabilities depend on the scale codes of the model packet and on the payload itself, so each
payload can be decoded whatever packets were lost.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from protocol.entropy.integer_codes import code_bits
from protocol.entropy.range_coder import PROBABILITY_ONE, BitCoder, RangeDecoder, RangeEncoder
from protocol.errors import ProtocolError
from protocol.frames.temporal_prediction import (
    CodedFrame,
    FramePredictor,
    coding_order,
    reconstruct,
    reference_magnitudes,
)
from protocol.frames.value_coding import ValueContext, code_value
from shared_model.arrays import Integers

_UNLIKELY_ONE = PROBABILITY_ONE - 512
_QUALITY_BITS = 5
_COUNT_BITS = 6


@dataclass(frozen=True, slots=True)
class PayloadHeader:
    """How a payload is coded.

    quality: 0 (finest step) to 31.
    frames: number of frames in the packet.
    intra: nothing is predicted from the packet before.
    unused_components: so many of the last components have no residuals in it.
    """

    quality: int
    frames: int
    intra: bool = False
    unused_components: int = 0


@dataclass(frozen=True, slots=True)
class ParsedPayload:
    """A decoded payload.

    values: the quantised residuals (n,) of each frame, in coding order.
    frames: the frames (n,), in order of time.
    """

    header: PayloadHeader
    values: list[tuple[CodedFrame, Integers]]
    frames: list[Integers]


def encode_payload(
    predictor: FramePredictor,
    sequence: int,
    nominal_frames: int,
    header: PayloadHeader,
    values: Sequence[tuple[CodedFrame, Integers]],
) -> bytes:
    """The payload of the frame packet with sequence number `sequence` (0..63).

    nominal_frames: frames in a packet whose header states no other number.
    values: quantised residuals (n,) of each frame, in coding order.
    """
    coder = RangeEncoder()
    for _ in code_payload_stepwise(coder, predictor, sequence, nominal_frames, header, values):
        pass
    return coder.finish()


def code_payload_stepwise(
    coder: BitCoder,
    predictor: FramePredictor,
    sequence: int,
    nominal_frames: int,
    header: PayloadHeader,
    values: Sequence[tuple[CodedFrame, Integers]],
) -> Iterator[int | None]:
    """Code a payload as `encode_payload` does and yield after each part.

    Yields None after the header, then the component's index after each value.
    """
    code_header(coder, header, nominal_frames, predictor.reserved)
    yield None
    context, magnitudes = ValueContext(), dict[int, Integers]()
    for frame, residuals in values:
        kinds = predictor.kinds(frame, sequence, header.intra)
        used = predictor.component_count - header.unused_components
        tables = predictor.base_tables(kinds, header.quality)[:used]
        references = reference_magnitudes(frame, magnitudes)
        coded = _code_values(coder, context, tables, references, residuals[:used])
        yield from (component for component, _ in enumerate(coded))
        magnitudes[frame.index] = np.abs(residuals)


def parse_payload(
    predictor: FramePredictor, sequence: int, nominal_frames: int, payload: bytes
) -> ParsedPayload:
    """Decode a payload; the predictor stays as it is: the last frame is its next anchor.

    Raises `ProtocolError` if no encoder makes the payload.
    """
    coder = RangeDecoder(payload)
    try:
        expected = PayloadHeader(0, nominal_frames)
        header = code_header(coder, expected, nominal_frames, predictor.reserved)
        values, decoded = _decode_frames(coder, predictor, sequence, header)
    except ValueError as error:
        raise ProtocolError(f"frame packet: {error}") from error
    if coder.unread_bytes:
        raise ProtocolError(f"frame packet: {coder.unread_bytes} bytes too many")
    return ParsedPayload(header, values, [decoded[index] for index in range(1, header.frames + 1)])


def code_header(
    coder: BitCoder, header: PayloadHeader, nominal_frames: int, reserved: int
) -> PayloadHeader:
    """Code a header, which it returns; a decoder ignores `header` and reads the coded one.

    nominal_frames: see `encode_payload`.  reserved: components that may be unused.
    Raises `ValueError` if a decoder reads more frames or unused components than there may be.
    """
    quality = code_bits(coder, header.quality, _QUALITY_BITS)
    intra = coder.code_bit(int(header.intra), _UNLIKELY_ONE)
    frames = nominal_frames
    if coder.code_bit(int(header.frames != nominal_frames), _UNLIKELY_ONE):
        frames = code_bits(coder, header.frames - 1, _COUNT_BITS) + 1
    if frames > nominal_frames:
        raise ValueError(f"{frames} frames, limit {nominal_frames}")
    unused = code_bits(coder, header.unused_components, reserved.bit_length())
    if unused > reserved:
        raise ValueError(f"{unused} components unused, limit {reserved}")
    return PayloadHeader(quality, frames, bool(intra), unused)


def _code_values(
    coder: BitCoder,
    context: ValueContext,
    tables: Integers,
    references: Integers | None,
    residuals: Integers,
) -> Iterator[int]:
    """Code the residuals of one frame; yield each as it is coded."""
    context.start_frame()
    sums = [0] * len(tables) if references is None else references[: len(tables)].tolist()
    for value, table, reference in zip(residuals.tolist(), tables.tolist(), sums, strict=True):
        value = code_value(coder, value, context.table(table, reference))
        context.update(table, abs(value))
        yield value


def _decode_frames(
    coder: BitCoder, predictor: FramePredictor, sequence: int, header: PayloadHeader
) -> tuple[list[tuple[CodedFrame, Integers]], dict[int, Integers]]:
    """The residuals of each frame in coding order, and the frames by index."""
    values, decoded, magnitudes = [], {0: predictor.anchor}, dict[int, Integers]()
    context, used = ValueContext(), predictor.component_count - header.unused_components
    for frame in coding_order(header.frames):
        kinds = predictor.kinds(frame, sequence, header.intra)
        tables = predictor.base_tables(kinds, header.quality)[:used]
        references = reference_magnitudes(frame, magnitudes)
        residuals = np.zeros(predictor.component_count, dtype=np.int64)
        residuals[:used] = list(_code_values(coder, context, tables, references, residuals[:used]))
        values.append((frame, residuals))
        magnitudes[frame.index] = np.abs(residuals)
        decoded[frame.index] = reconstruct(
            predictor, frame, kinds, decoded, header.quality, residuals
        )
    return values, decoded
