"""Frame packets of the default profile: both ends in step, loss forgotten, bad bytes refused."""

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicted_frames import (
    NOMINAL_FRAMES,
    RESERVED,
    SCALE_CODES,
    decode_payload,
    packets,
    predictor,
    send,
    walk,
)

from protocol.entropy.integer_codes import code_bits
from protocol.entropy.range_coder import RangeEncoder
from protocol.errors import ProtocolError
from protocol.frames.temporal_prediction import (
    ANCHOR,
    MAX_VALUE,
    PREDICTION_KINDS,
    REFRESH_PERIOD,
    STEPS_PER_UNIT,
    CodedFrame,
    FramePredictor,
    coding_order,
    interpolate,
    reference_magnitudes,
    step,
)
from protocol.frames.value_coding import MAX_MAGNITUDE
from protocol.limits import MAX_FRAME_PAYLOAD_BYTES
from shared_model.arrays import Integers

VECTORS = Path(__file__).parents[2] / "vectors"


def extensible_packets(seed: int) -> list[tuple[int, bytes, Integers]]:
    """(sequence, payload, frames) of a call whose reserved components come into use two by two."""
    sender, frames, call = predictor(RESERVED), walk(seed, 4 * NOMINAL_FRAMES), []
    for sequence, unused in enumerate((6, 4, 2, 0)):
        part = frames[NOMINAL_FRAMES * sequence : NOMINAL_FRAMES * (sequence + 1)]
        part[:, len(SCALE_CODES) - unused :] = 0
        call.append((sequence, *send(sender, sequence, part, 2, not sequence, unused)))
    return call


@pytest.mark.parametrize(
    ("name", "call"),
    [("frames_default", packets(1, 5)), ("frames_reserved", extensible_packets(1))],
)
def test_golden_packets_have_not_changed(
    name: str, call: list[tuple[int, bytes, Integers]]
) -> None:
    data = [bytes.fromhex(line) for line in (VECTORS / f"{name}.hex").read_text().split()]
    assert data == [payload for _, payload, _ in call]


def test_reserved_components_come_into_use_during_a_call() -> None:
    receiver = predictor(RESERVED)
    for sequence, payload, frames in extensible_packets(3):
        assert np.array_equal(decode_payload(receiver, sequence, NOMINAL_FRAMES, payload), frames)
        used = len(SCALE_CODES) - RESERVED + 2 * sequence
        assert frames[:, :used].any(0).all() and not frames[:, used:].any()


def test_unused_components_take_no_bytes() -> None:
    saved = 0
    for seed in range(5):
        wanted = walk(seed, NOMINAL_FRAMES)
        wanted[:, -RESERVED:] = 0
        resting, awake = (
            send(predictor(RESERVED), 0, wanted, unused=unused)[0] for unused in (RESERVED, 0)
        )
        fewer = send(FramePredictor(SCALE_CODES[:-RESERVED]), 0, wanted[:, :-RESERVED])[0]
        # Three bits say how many are unused.
        assert len(fewer) <= len(resting) <= len(fewer) + 1
        saved += len(awake) - len(resting)
    assert saved > 0


def test_frames_between_are_expected_on_a_cubic() -> None:
    polynomials = np.array([[5, -70, 900, 4000], [0, 40, -300, 100], [0, 0, 77, 9], [0, 0, 0, 3]])
    frames = np.array([[np.polyval(p, t) for p in polynomials] for t in range(9)], np.int64)
    known = {index: frames[index] for index in range(0, 9, 2)}
    for index in (3, 5):
        place = CodedFrame(index, index - 1, index + 1, PREDICTION_KINDS - 1)
        assert np.abs(interpolate(place, known) - frames[index]).max() <= 1
    # Nothing is known beyond the ends: what moves straight is met all the same.
    for index in (1, 7):
        place = CodedFrame(index, index - 1, index + 1, PREDICTION_KINDS - 1)
        assert np.array_equal(interpolate(place, known)[2:], frames[index, 2:])
    alone = {0: frames[0], 8: frames[8]}
    middle = interpolate(CodedFrame(4, 0, 8, ANCHOR + 1), alone)
    assert np.array_equal(middle, (frames[0] + frames[8]) // 2)


@pytest.mark.parametrize("seed", range(3))
def test_both_ends_stay_in_step_throughout_a_call(seed: int) -> None:
    receiver = predictor()
    for sequence, payload, frames in packets(seed, 70):
        assert np.array_equal(decode_payload(receiver, sequence, NOMINAL_FRAMES, payload), frames)


@pytest.mark.parametrize("lost", [{3}, {5, 6}, {2, 9, 20}, {61, 62}])
def test_a_lost_packet_has_no_effect_after_a_refresh_period(lost: set[int]) -> None:
    receiver, call = predictor(), packets(4, 70)
    for number, (sequence, payload, frames) in enumerate(call):
        if number in lost:
            continue
        decoded = np.array(decode_payload(receiver, sequence, NOMINAL_FRAMES, payload))
        # Where the sequence number wraps, one packet more.
        if not any(number - REFRESH_PERIOD - 1 <= gone < number for gone in lost):
            assert np.array_equal(decoded[-1], frames[-1])


def test_an_intra_packet_needs_no_packet_before() -> None:
    sender, receiver = predictor(), predictor()
    send(sender, 0, walk(5, NOMINAL_FRAMES))
    receiver.anchor = receiver.anchor + 12345
    payload, frames = send(sender, 1, walk(6, NOMINAL_FRAMES), intra=True)
    assert np.array_equal(decode_payload(receiver, 1, NOMINAL_FRAMES, payload)[-1], frames[-1])


def test_a_motionless_face_costs_hardly_a_byte() -> None:
    sender = predictor()
    sender.anchor = np.zeros(len(SCALE_CODES), dtype=np.int64)
    payload, _ = send(
        sender, 1, np.zeros((NOMINAL_FRAMES, len(SCALE_CODES)), dtype=np.int64), quality=8
    )
    assert len(payload) <= 6


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 16, 64])
def test_every_frame_is_coded_once_after_those_it_is_between(count: int) -> None:
    order = coding_order(count)
    assert sorted(place.index for place in order) == list(range(1, count + 1))
    known = {0}
    for place in order:
        assert {place.left, place.right} <= known and place.kind < PREDICTION_KINDS
        assert place.left <= place.index
        known.add(place.index)


def test_steps_double_every_four_qualities() -> None:
    for kind in range(PREDICTION_KINDS):
        assert [step(q + 4, kind) for q in range(28)] == [2 * step(q, kind) for q in range(28)]
    assert step(8, 0) == STEPS_PER_UNIT


def test_parents_are_the_frames_within_the_packet() -> None:
    sizes = {8: np.array([1, 2]), 4: np.array([3, 4])}
    assert reference_magnitudes(CodedFrame(8, 0, 0, 1), {}) is None
    between, first = (
        reference_magnitudes(CodedFrame(6, 4, 8, 3), sizes),
        reference_magnitudes(CodedFrame(2, 0, 4, 3), sizes),
    )
    assert between is not None and between.tolist() == [4, 6]
    assert first is not None and first.tolist() == [3, 4]


@pytest.mark.no_cover
@pytest.mark.parametrize(("spare", "call"), [(0, packets(7, 3)), (RESERVED, extensible_packets(7))])
def test_every_truncation_and_bit_flip_is_frames_or_a_protocol_error(
    spare: int, call: list[tuple[int, bytes, Integers]]
) -> None:
    for sequence, payload, _ in call:
        for length in range(len(payload)):
            decodes_or_protocol_error(sequence, payload[:length], spare)
        for bit in range(8 * len(payload)):
            flipped = bytearray(payload)
            flipped[bit // 8] ^= 1 << bit % 8
            decodes_or_protocol_error(sequence, bytes(flipped), spare)


@pytest.mark.no_cover
def test_fuzz_of_random_payloads() -> None:
    seed = 8128
    print(f"seed {seed}")
    rng = random.Random(seed)
    for _ in range(1500):
        payload = rng.randbytes(rng.randint(0, 60))
        decodes_or_protocol_error(rng.randrange(64), payload, rng.choice((0, RESERVED)))
    decodes_or_protocol_error(0, b"\xff" * MAX_FRAME_PAYLOAD_BYTES)


def decodes_or_protocol_error(sequence: int, payload: bytes, reserved: int = 0) -> None:
    """Fails by any other exception, and if frames are more or larger than allowed."""
    receiver = predictor(reserved)
    before = receiver.anchor
    try:
        frames = decode_payload(receiver, sequence, NOMINAL_FRAMES, payload)
    except ProtocolError:
        assert receiver.anchor is before
        return
    assert 1 <= len(frames) <= NOMINAL_FRAMES
    assert all(np.abs(frame).max() <= MAX_VALUE for frame in frames)


def test_too_many_frames_are_refused() -> None:
    coder = RangeEncoder()
    code_bits(coder, 0, 5)
    coder.code_bit(0, 65536 - 512)
    coder.code_bit(1, 65536 - 512)
    code_bits(coder, NOMINAL_FRAMES, 6)
    with pytest.raises(ProtocolError, match="9 frames, limit 8"):
        decode_payload(predictor(), 0, NOMINAL_FRAMES, coder.finish())


def test_more_unused_components_than_reserved_ones_are_refused() -> None:
    coder = RangeEncoder()
    code_bits(coder, 0, 5)
    coder.code_bit(0, 65536 - 512)
    coder.code_bit(0, 65536 - 512)
    code_bits(coder, RESERVED + 1, 3)
    with pytest.raises(ProtocolError, match="7 components unused, limit 6"):
        decode_payload(predictor(RESERVED), 0, NOMINAL_FRAMES, coder.finish())


def test_bytes_too_many_are_refused() -> None:
    sequence, payload, _ = packets(9, 1)[1]
    with pytest.raises(ProtocolError, match="bytes too many"):
        decode_payload(predictor(), sequence, NOMINAL_FRAMES, payload + bytes(8))


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 31), st.integers(1, NOMINAL_FRAMES), st.integers(0, 63), st.integers(0, 2**32)
)
def test_any_quality_and_length_round_trips(
    quality: int, count: int, sequence: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    wanted = rng.integers(-(2**20), 2**20, size=(count, len(SCALE_CODES)))
    limit = MAX_MAGNITUDE * step(quality, 0)
    wanted = np.clip(wanted, -limit // 2, limit // 2)
    sender, receiver = predictor(), predictor()
    payload, frames = send(sender, sequence, wanted, quality)
    assert np.array_equal(decode_payload(receiver, sequence, NOMINAL_FRAMES, payload), frames)
