"""Frame packets of the default profile, quantised and coded plainly."""

import numpy as np

from protocol.frames.payload_coding import PayloadHeader, encode_payload, parse_payload
from protocol.frames.temporal_prediction import (
    MAX_SCALE_CODE,
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    FramePredictor,
    coding_order,
    reconstruct,
    step,
)
from protocol.limits import SEQUENCE_MODULUS
from shared_model.arrays import Integers

NOMINAL_FRAMES, RESERVED = 8, 6
SCALE_CODES = np.clip(
    np.arange(20)[:, None] * -1 + np.array([40, 30, 28, 26, 24]), 0, MAX_SCALE_CODE
)


def predictor(reserved: int = 0) -> FramePredictor:
    return FramePredictor(SCALE_CODES, reserved)


def walk(seed: int, count: int) -> Integers:
    """(count, n) frames, in 1 / STEPS_PER_UNIT, of components that vary slowly."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(count, len(SCALE_CODES))) * 2.0 ** (SCALE_CODES[:, 1] / 4 - 4)
    state, frames = np.zeros(len(SCALE_CODES)), []
    for kick in noise:
        state = 0.9 * state + 0.5 * kick
        frames.append(state)
    return np.asarray(np.rint(np.array(frames) * STEPS_PER_UNIT), dtype=np.int64)


def send(
    sender: FramePredictor,
    sequence: int,
    wanted: Integers,
    quality: int = 12,
    intra: bool = False,
    unused: int = 0,
) -> tuple[bytes, Integers]:
    """Quantise and code plainly; returns the payload and the frames a receiver gets."""
    head = PayloadHeader(quality, len(wanted), intra, unused)
    known, values = {0: sender.anchor}, []
    for place in coding_order(len(wanted)):
        kinds = sender.kinds(place, sequence, intra)
        steps = np.array([step(quality, kind) for kind in range(PREDICTION_KINDS)])[kinds]
        error = wanted[place.index - 1] - sender.predict(place, kinds, known)
        values.append((place, np.rint(error / steps).astype(np.int64)))
        known[place.index] = reconstruct(sender, place, kinds, known, quality, values[-1][1])
    payload = encode_payload(sender, sequence, NOMINAL_FRAMES, head, values)
    sender.anchor = known[len(wanted)]
    return payload, np.array([known[index] for index in range(1, len(wanted) + 1)])


def packets(seed: int, count: int) -> list[tuple[int, bytes, Integers]]:
    """(sequence, payload, frames) of a call."""
    sender, frames = predictor(), walk(seed, 1 + NOMINAL_FRAMES * count)
    call = [(0, *send(sender, 0, frames[:1], intra=True))]
    for number in range(1, count + 1):
        sequence = number % SEQUENCE_MODULUS
        part = frames[1 + NOMINAL_FRAMES * (number - 1) : 1 + NOMINAL_FRAMES * number]
        call.append((sequence, *send(sender, sequence, part)))
    return call


def decode_payload(
    predictor: FramePredictor, sequence: int, nominal_frames: int, payload: bytes
) -> list[Integers]:
    """The frames (n,) of a payload, in order of time; the last becomes the predictor's anchor.

    Raises `ProtocolError` if no encoder makes the payload.
    """
    parsed = parse_payload(predictor, sequence, nominal_frames, payload)
    predictor.anchor = parsed.frames[-1]
    return parsed.frames
