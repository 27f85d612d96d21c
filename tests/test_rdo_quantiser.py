"""Quantisation weighs harm against bits and leaves encoder and decoder with the same frames."""

import numpy as np
import pytest

from encoder.coding import rdo_quantiser as quantiser
from encoder.coding.rdo_quantiser import LAGRANGIAN, code_packet
from protocol.frames.payload_coding import decode_payload, parse_payload
from protocol.frames.temporal_prediction import (
    ANCHOR,
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    FramePredictor,
    step,
)

USUAL, COMPONENTS, SPARE = 8, 10, 4


def predictor(spare: int = 0) -> FramePredictor:
    return FramePredictor(np.tile([40, 34, 30, 28, 26], (COMPONENTS, 1)), spare)


def targets(scale: float, seed: int = 2) -> np.ndarray:
    """(8, n) values, units, of frames that move smoothly."""
    rng = np.random.default_rng(seed)
    return np.asarray(np.cumsum(rng.normal(size=(USUAL, COMPONENTS)), axis=0) * scale)


@pytest.mark.parametrize("quality", [0, 8, 16, 31])
def test_a_decoder_gets_the_encoders_frames(quality: int) -> None:
    sender, receiver = predictor(), predictor()
    for sequence in range(5):
        packet = code_packet(sender, sequence, USUAL, targets(3, sequence), quality)
        frames = decode_payload(receiver, sequence, USUAL, packet.payload)
        assert np.array_equal(frames, packet.frames)
        sender.anchor = packet.frames[-1]


@pytest.mark.parametrize("quality", [0, 8, 16])
def test_no_value_is_further_off_than_its_bits_are_worth(quality: int) -> None:
    wanted = targets(4)
    packet = code_packet(predictor(), 0, USUAL, wanted, quality, intra=True)
    error = np.abs(packet.frames / STEPS_PER_UNIT - wanted)
    # A value may be a step too small, or zero where a first bit costs more than it mends.
    assert (
        error.max()
        <= (1 + np.sqrt(16 * LAGRANGIAN)) * step(quality, PREDICTION_KINDS - 1) / STEPS_PER_UNIT
    )
    assert np.sqrt((error**2).mean()) < step(quality, PREDICTION_KINDS - 1) / STEPS_PER_UNIT


def test_finer_qualities_cost_more_and_harm_less() -> None:
    wanted, sizes, errors = targets(4), [], []
    for quality in (0, 8, 16, 24):
        packet = code_packet(predictor(), 0, USUAL, wanted, quality)
        sizes.append(len(packet.payload))
        errors.append(float(((packet.frames / STEPS_PER_UNIT - wanted) ** 2).sum()))
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)


def test_what_is_not_worth_its_bits_is_not_sent() -> None:
    nothing = code_packet(predictor(), 1, USUAL, np.zeros((USUAL, COMPONENTS)), 8)
    little = code_packet(predictor(), 1, USUAL, np.full((USUAL, COMPONENTS), 0.3), 8)
    assert little.payload == nothing.payload
    assert not little.frames.any()


def test_values_chosen_together_are_worth_more(monkeypatch: pytest.MonkeyPatch) -> None:
    quality = 12
    bit = LAGRANGIAN * (step(quality, ANCHOR) / STEPS_PER_UNIT) ** 2

    def cost(sweeps: int) -> float:
        monkeypatch.setattr(quantiser, "SWEEPS", sweeps)
        total = 0.0
        for seed in range(20):
            wanted = targets(2, seed)
            packet = code_packet(predictor(), 0, USUAL, wanted, quality)
            total += float(((packet.frames / STEPS_PER_UNIT - wanted) ** 2).sum())
            total += 8 * bit * len(packet.payload)
        return total

    assert cost(quantiser.ITERATIONS) < 0.95 * cost(0)


def test_a_packet_that_knows_the_next_one_serves_it_better() -> None:
    # What trembles about a mean is not followed; the mean is better than the last tremble.
    wanted = np.random.default_rng(4).normal(size=(20, 2 * USUAL, COMPONENTS))

    def harm(known: bool) -> float:
        total = 0.0
        for call in wanted:
            sender, (first, second) = predictor(), (call[:USUAL], call[USUAL:])
            packet = code_packet(sender, 1, USUAL, first, 8, next_targets=second if known else None)
            sender.anchor = packet.frames[-1]
            after = code_packet(sender, 2, USUAL, second, 8)
            found = np.concatenate([packet.frames, after.frames]) / STEPS_PER_UNIT
            total += float(((found - call) ** 2).sum())
            total += 8 * LAGRANGIAN * (len(packet.payload) + len(after.payload))
        return total

    assert harm(known=True) < harm(known=False)


def test_a_next_packet_of_one_frame_changes_nothing() -> None:
    packets = [
        code_packet(predictor(), 0, USUAL, targets(3), 8, next_targets=coming).payload
        for coming in (None, np.ones((1, COMPONENTS)))
    ]
    assert packets[0] == packets[1]


def test_coding_does_not_move_the_predictor() -> None:
    sender = predictor()
    sender.anchor = np.arange(COMPONENTS, dtype=np.int64)
    first = code_packet(sender, 3, USUAL, targets(2), 8)
    assert np.array_equal(sender.anchor, np.arange(COMPONENTS))
    assert code_packet(sender, 3, USUAL, targets(2), 8).payload == first.payload


@pytest.mark.parametrize("unused", range(COMPONENTS + 1))
def test_spare_components_without_a_value_are_left_out(unused: int) -> None:
    wanted = targets(3)
    wanted[:, COMPONENTS - unused :] = 0
    packet = code_packet(predictor(SPARE), 0, USUAL, wanted, 4)
    found = parse_payload(predictor(SPARE), 0, USUAL, packet.payload)
    assert found.header.unused_components == min(unused, SPARE)
    assert np.array_equal(found.frames, packet.frames)
    assert packet.frames[:, : COMPONENTS - unused].any(0).all()
    assert not packet.frames[:, COMPONENTS - unused :].any()


def test_a_spare_component_that_returns_to_nothing_is_sent_until_it_is_there() -> None:
    sender, receiver, wanted = predictor(SPARE), predictor(SPARE), np.zeros((USUAL, COMPONENTS))
    idle = []
    for sequence, last in enumerate((0.0, 40.0, 0.0, 0.0)):
        wanted[:, -1] = last
        packet = code_packet(sender, sequence, USUAL, wanted, 4)
        idle.append(
            parse_payload(receiver, sequence, USUAL, packet.payload).header.unused_components
        )
        assert np.array_equal(
            decode_payload(receiver, sequence, USUAL, packet.payload), packet.frames
        )
        sender.anchor = packet.frames[-1]
    assert idle == [SPARE, 0, 0, SPARE]
