"""RDOQ: bits against distortion, and equal frames in encoder and decoder."""

import numpy as np
import pytest
from predicted_frames import decode_payload

from encoder.coding import rdo_quantiser as quantiser
from encoder.coding.rdo_quantiser import LAGRANGIAN, code_packet
from protocol.frames.payload_coding import parse_payload
from protocol.frames.temporal_prediction import (
    ANCHOR,
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    FramePredictor,
    step,
)

NOMINAL, COMPONENTS, RESERVED = 8, 10, 4


def predictor(reserved: int = 0) -> FramePredictor:
    return FramePredictor(np.tile([40, 34, 30, 28, 26], (COMPONENTS, 1)), reserved)


def targets(scale: float, seed: int = 2) -> np.ndarray:
    """(8, n) values, units, of frames that move smoothly."""
    rng = np.random.default_rng(seed)
    return np.asarray(np.cumsum(rng.normal(size=(NOMINAL, COMPONENTS)), axis=0) * scale)


@pytest.mark.parametrize("quality", [0, 8, 16, 31])
def test_a_decoder_gets_the_encoders_frames(quality: int) -> None:
    sender, receiver = predictor(), predictor()
    for sequence in range(5):
        packet = code_packet(sender, sequence, NOMINAL, targets(3, sequence), quality)
        frames = decode_payload(receiver, sequence, NOMINAL, packet.payload)
        assert np.array_equal(frames, packet.frames)
        sender.anchor = packet.frames[-1]


@pytest.mark.parametrize("quality", [0, 8, 16])
def test_no_value_is_further_off_than_its_bits_are_worth(quality: int) -> None:
    wanted = targets(4)
    packet = code_packet(predictor(), 0, NOMINAL, wanted, quality, intra=True)
    error = np.abs(packet.frames / STEPS_PER_UNIT - wanted)
    # A value may be a step too small, or zero where its first bit costs more than it gains.
    assert (
        error.max()
        <= (1 + np.sqrt(16 * LAGRANGIAN)) * step(quality, PREDICTION_KINDS - 1) / STEPS_PER_UNIT
    )
    assert np.sqrt((error**2).mean()) < step(quality, PREDICTION_KINDS - 1) / STEPS_PER_UNIT


def test_finer_qualities_cost_more_and_distort_less() -> None:
    wanted, sizes, errors = targets(4), [], []
    for quality in (0, 8, 16, 24):
        packet = code_packet(predictor(), 0, NOMINAL, wanted, quality)
        sizes.append(len(packet.payload))
        errors.append(float(((packet.frames / STEPS_PER_UNIT - wanted) ** 2).sum()))
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)


def test_values_that_are_not_worth_their_bits_are_zero() -> None:
    nothing = code_packet(predictor(), 1, NOMINAL, np.zeros((NOMINAL, COMPONENTS)), 8)
    little = code_packet(predictor(), 1, NOMINAL, np.full((NOMINAL, COMPONENTS), 0.3), 8)
    assert little.payload == nothing.payload
    assert not little.frames.any()


def test_coordinate_descent_lowers_the_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    quality = 12
    bit = LAGRANGIAN * (step(quality, ANCHOR) / STEPS_PER_UNIT) ** 2

    def cost(iterations: int) -> float:
        monkeypatch.setattr(quantiser, "ITERATIONS", iterations)
        total = 0.0
        for seed in range(20):
            wanted = targets(2, seed)
            packet = code_packet(predictor(), 0, NOMINAL, wanted, quality)
            total += float(((packet.frames / STEPS_PER_UNIT - wanted) ** 2).sum())
            total += 8 * bit * len(packet.payload)
        return total

    assert cost(quantiser.ITERATIONS) < 0.95 * cost(0)


def test_look_ahead_to_the_next_packet_lowers_the_cost_of_both() -> None:
    # Of noise about a mean, the mean is a better reference than the last frame.
    wanted = np.random.default_rng(4).normal(size=(20, 2 * NOMINAL, COMPONENTS))

    def cost(known: bool) -> float:
        total = 0.0
        for call in wanted:
            sender, (first, second) = predictor(), (call[:NOMINAL], call[NOMINAL:])
            packet = code_packet(
                sender, 1, NOMINAL, first, 8, next_targets=second if known else None
            )
            sender.anchor = packet.frames[-1]
            after = code_packet(sender, 2, NOMINAL, second, 8)
            found = np.concatenate([packet.frames, after.frames]) / STEPS_PER_UNIT
            total += float(((found - call) ** 2).sum())
            total += 8 * LAGRANGIAN * (len(packet.payload) + len(after.payload))
        return total

    assert cost(known=True) < cost(known=False)


def test_a_next_packet_of_one_frame_changes_nothing() -> None:
    packets = [
        code_packet(predictor(), 0, NOMINAL, targets(3), 8, next_targets=following).payload
        for following in (None, np.ones((1, COMPONENTS)))
    ]
    assert packets[0] == packets[1]


def test_coding_does_not_move_the_predictor() -> None:
    sender = predictor()
    sender.anchor = np.arange(COMPONENTS, dtype=np.int64)
    first = code_packet(sender, 3, NOMINAL, targets(2), 8)
    assert np.array_equal(sender.anchor, np.arange(COMPONENTS))
    assert code_packet(sender, 3, NOMINAL, targets(2), 8).payload == first.payload


@pytest.mark.parametrize("unused", range(COMPONENTS + 1))
def test_trailing_reserved_components_without_a_value_are_not_coded(unused: int) -> None:
    wanted = targets(3)
    wanted[:, COMPONENTS - unused :] = 0
    packet = code_packet(predictor(RESERVED), 0, NOMINAL, wanted, 4)
    found = parse_payload(predictor(RESERVED), 0, NOMINAL, packet.payload)
    assert found.header.unused_components == min(unused, RESERVED)
    assert np.array_equal(found.frames, packet.frames)
    assert packet.frames[:, : COMPONENTS - unused].any(0).all()
    assert not packet.frames[:, COMPONENTS - unused :].any()


def test_a_reserved_component_is_coded_until_its_anchor_is_zero() -> None:
    """Also one that has returned to zero."""
    sender, receiver, wanted = (
        predictor(RESERVED),
        predictor(RESERVED),
        np.zeros((NOMINAL, COMPONENTS)),
    )
    unused_counts = []
    for sequence, last in enumerate((0.0, 40.0, 0.0, 0.0)):
        wanted[:, -1] = last
        packet = code_packet(sender, sequence, NOMINAL, wanted, 4)
        unused_counts.append(
            parse_payload(receiver, sequence, NOMINAL, packet.payload).header.unused_components
        )
        assert np.array_equal(
            decode_payload(receiver, sequence, NOMINAL, packet.payload), packet.frames
        )
        sender.anchor = packet.frames[-1]
    assert unused_counts == [RESERVED, 0, 0, RESERVED]
