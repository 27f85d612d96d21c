"""Rate control: no window exceeds the rate, and little of the rate is unused."""

import numpy as np
import pytest
from predicted_frames import decode_payload

from encoder.coding.rate_control import (
    QUALITIES,
    QUALITY_INTERLEAVE,
    WINDOW_S,
    OnlineRateController,
    RateTarget,
    SlidingWindowBudget,
    code_call,
    packet_bits,
    packet_quality,
    packet_spans,
)
from encoder.coding.rdo_quantiser import CodedPacket
from encoder.coding.transform import estimate_scales
from protocol.frames.temporal_prediction import STEPS_PER_UNIT, FramePredictor
from protocol.limits import SEQUENCE_MODULUS

FPS, NOMINAL, COMPONENTS = 25.0, 8, 8


def busy_values(seconds: float, seed: int = 1) -> np.ndarray:
    """(t, n) values that could use any rate; for a third of the time they move five times more."""
    rng = np.random.default_rng(seed)
    count = int(seconds * FPS)
    kicks = rng.normal(size=(count, COMPONENTS)) * 0.7 ** np.arange(COMPONENTS) * 40
    kicks[count // 3 : 2 * count // 3] *= 5
    values = np.zeros_like(kicks)
    for t in range(1, count):
        values[t] = 0.95 * values[t - 1] + kicks[t]
    return values


def code(values: np.ndarray, bitrate: float) -> list[CodedPacket]:
    return code_call(values, estimate_scales(values, NOMINAL), RateTarget(bitrate, FPS, NOMINAL))


def window_rates(packets: list[CodedPacket], frames: int) -> list[float]:
    """Bits a second of every run of whole packets that is as long as a window, or just shorter."""
    spans = packet_spans(frames, NOMINAL)
    bits = [packet_bits(packet) for packet in packets]
    rates = []
    for first, (start, _) in enumerate(spans):
        inside = [n for n in range(first, len(spans)) if spans[n][1] - start <= WINDOW_S * FPS]
        if spans[-1][1] - start >= WINDOW_S * FPS:
            rates.append(sum(bits[n] for n in inside) / WINDOW_S)
    return rates


def test_no_window_takes_more_than_the_rate_and_the_busiest_use_it() -> None:
    values, bitrate = busy_values(12), 600.0
    rates = window_rates(code(values, bitrate), len(values))
    assert max(rates) <= bitrate
    # A packet more would not fit: the busy third is held within three hundredths.
    assert max(rates) >= 0.97 * bitrate


def test_a_steady_call_uses_its_rate() -> None:
    values, bitrate = busy_values(30)[: int(10 * FPS)], 1000.0
    packets = code(values, bitrate)
    rate = sum(map(packet_bits, packets)) / (len(values) / FPS)
    assert 0.97 * bitrate <= rate <= bitrate
    assert min(window_rates(packets, len(values))) > 0.8 * bitrate


def test_more_bits_bring_the_decoded_values_nearer() -> None:
    values, errors = busy_values(5), []
    for bitrate in (300.0, 800.0, 2400.0):
        frames = (
            np.concatenate([packet.frames for packet in code(values, bitrate)]) / STEPS_PER_UNIT
        )
        errors.append(float(((frames - values) ** 2).mean()))
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def test_a_decoder_has_the_encoders_frames_throughout_a_call() -> None:
    values = busy_values(6)
    scale_codes = estimate_scales(values, NOMINAL)
    receiver = FramePredictor(scale_codes)
    for number, packet in enumerate(code_call(values, scale_codes, RateTarget(800, FPS, NOMINAL))):
        frames = decode_payload(receiver, number % SEQUENCE_MODULUS, NOMINAL, packet.payload)
        assert np.array_equal(frames, packet.frames)


def test_a_motionless_face_takes_almost_no_bits() -> None:
    values = np.zeros((int(8 * FPS), COMPONENTS))
    packets = code_call(
        values, estimate_scales(busy_values(8), NOMINAL), RateTarget(800, FPS, NOMINAL)
    )
    assert sum(len(packet.payload) for packet in packets[1:]) < 3 * len(packets)


def test_a_rate_that_is_too_low_gets_the_coarsest_quality() -> None:
    values = busy_values(4)
    packets = code(values, 1.0)
    assert len(packets) == len(packet_spans(len(values), NOMINAL))
    assert sum(map(packet_bits, packets)) < 0.2 * sum(map(packet_bits, code(values, 3000)))


@pytest.mark.parametrize("live", [False, True])
def test_a_rate_that_is_too_low_is_reported_with_the_rate_it_takes(live: bool) -> None:
    values = busy_values(6)
    scale_codes = estimate_scales(values, NOMINAL)

    def packets_and_message(bitrate: float) -> tuple[list[CodedPacket], str | None]:
        target = RateTarget(bitrate, FPS, NOMINAL)
        if not live:
            packets = code_call(values, scale_codes, target)
            return packets, target.overshoot_message(sum(map(packet_bits, packets)), len(values))
        controller, predictor, packets = (
            OnlineRateController(target),
            FramePredictor(scale_codes),
            [],
        )
        for number, span in enumerate(packet_spans(len(values), NOMINAL)):
            packets.append(controller.encode_packet(predictor, number, values[slice(*span)]))
            predictor.anchor = packets[-1].frames[-1]
        return packets, controller.overshoot_message

    packets, message = packets_and_message(20.0)
    taken = sum(map(packet_bits, packets)) * FPS / len(values)
    assert message is not None and "--bitrate 20 is" in message
    assert f"takes {np.ceil(taken):.0f} bits a second" in message
    assert packets_and_message(800.0)[1] is None


def test_the_debt_of_the_first_frame_is_not_reported() -> None:
    target, values = RateTarget(200.0, FPS, NOMINAL), busy_values(12)[100:109]
    controller, predictor = (
        OnlineRateController(target),
        FramePredictor(estimate_scales(values, NOMINAL)),
    )
    # The first frame takes more than its share of the rate, and the next packet repays it.
    first = controller.encode_packet(predictor, 0, values[:1])
    predictor.anchor = first.frames[-1]
    second = controller.encode_packet(predictor, 1, np.repeat(values[:1], NOMINAL, axis=0))
    taken = packet_bits(first) + packet_bits(second)
    assert packet_bits(second) < 200 * NOMINAL / FPS and taken > 200 * (1 + NOMINAL) / FPS
    assert controller.overshoot_message is None


def test_an_excess_in_the_last_packet_is_not_reported() -> None:
    target, busy = RateTarget(400.0, FPS, NOMINAL), busy_values(12)[100:109]
    wild = busy[0] + 9 * (busy[1:] - busy[0])
    values = np.concatenate([np.repeat(busy[:1], 1 + 3 * NOMINAL, axis=0), wild])
    controller, predictor = (
        OnlineRateController(target),
        FramePredictor(estimate_scales(busy, NOMINAL)),
    )
    bits = []
    for number, span in enumerate(packet_spans(len(values), NOMINAL)):
        packet = controller.encode_packet(predictor, number, values[slice(*span)])
        predictor.anchor = packet.frames[-1]
        bits.append(packet_bits(packet))
    # The last packet exceeds its share at the coarsest quality, and no packet follows to repay it.
    assert bits[-1] > 400 * NOMINAL / FPS and sum(bits) > 400 * len(values) / FPS
    assert controller.overshoot_message is None


def test_an_excess_that_is_never_repaid_is_reported() -> None:
    target, busy = RateTarget(400.0, FPS, NOMINAL), busy_values(12)[100:109]
    wild = busy[0] + 9 * (busy[1:] - busy[0])
    stretch = [*[wild] * 6, *[np.repeat(busy[:1], NOMINAL, axis=0)] * 36]
    controller, predictor = (
        OnlineRateController(target),
        FramePredictor(estimate_scales(busy, NOMINAL)),
    )
    packets = [busy[:1], *stretch * 3]
    taken = 0
    for number, values in enumerate(packets):
        packet = controller.encode_packet(predictor, number, values)
        predictor.anchor = packet.frames[-1]
        taken += packet_bits(packet)
    assert taken > 1.1 * 400 * sum(map(len, packets)) / FPS
    assert controller.overshoot_message is not None and "too little" in controller.overshoot_message


def test_levels_run_from_the_finest_to_the_coarsest_quality() -> None:
    numbers = range(3 * QUALITY_INTERLEAVE)
    assert {packet_quality(0, n) for n in numbers} == {0}
    assert {packet_quality(QUALITY_INTERLEAVE * (QUALITIES - 1), n) for n in numbers} == {
        QUALITIES - 1
    }
    for level in range(QUALITY_INTERLEAVE * (QUALITIES - 1) + 1):
        mean = np.mean([packet_quality(level, n) for n in numbers])
        assert mean == pytest.approx(level / QUALITY_INTERLEAVE)


@pytest.mark.parametrize("frames", [1, 2, 8, 9, 10, 100])
def test_spans_cover_every_frame_once(frames: int) -> None:
    spans = packet_spans(frames, NOMINAL)
    assert [i for start, end in spans for i in range(start, end)] == list(range(frames))
    assert spans[0] == (0, 1) and all(end - start <= NOMINAL for start, end in spans)


def test_the_first_packet_may_take_the_budget_of_a_whole_window() -> None:
    def encode(quality: int) -> CodedPacket:
        return CodedPacket(bytes(320 >> quality), np.zeros((8, 1), np.int64))

    window = SlidingWindowBudget(RateTarget(800, FPS, NOMINAL))
    sizes = [len(window.encode_within_budget(encode, 0, NOMINAL).payload) for _ in range(4)]
    assert sizes[0] == 320
    assert 8 * sum(sizes) <= 800 * WINDOW_S and sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize("seconds", [3, 24])
def test_a_live_call_uses_its_rate_from_the_start_and_keeps_it(seconds: int) -> None:
    rng = np.random.default_rng(5)
    values = np.cumsum(rng.normal(size=(25 * seconds + 1, 6)), axis=0) * 3
    scale_codes = estimate_scales(values, 8)
    target = RateTarget(800.0, 25.0, 8)
    controller, predictor, bits = OnlineRateController(target), FramePredictor(scale_codes), 0
    for number, (start, end) in enumerate(packet_spans(len(values), 8)):
        packet = controller.encode_packet(predictor, number, values[start:end])
        predictor.anchor = packet.frames[-1]
        bits += packet_bits(packet)
    assert 0.97 * 800 < bits / (len(values) / 25) <= 800
