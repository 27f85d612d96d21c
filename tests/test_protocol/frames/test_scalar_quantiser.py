"""The thesis profile: precision, range and exactness of its codes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import (
    AAU_STEP,
    EAU_STEP,
    THESIS_TABLE,
    codes_from_parameters,
    codes_from_values,
    decode_thesis,
    encode_thesis,
    motion_from_pose,
    parameters_from_codes,
    pose_from_motion,
    thesis_sample_count,
    values_from_codes,
)
from shared_model.geometry import (
    conjugate,
    multiply,
    pose_from_euler,
    vector_from_quaternion,
)
from shared_model.parameters import EAU_INDEX, EAUS, LID_EAUS, THESIS_EAUS, FaceParameters, Pose

REFERENCE = pose_from_euler(4.0, -12.0, 3.0, np.array([30.0, -20.0, 650.0]))
GOLDEN = FaceParameters(
    pose_from_euler(-3.0, 10.0, -6.0, np.array([10.0, 15.0, 700.0])),
    np.linspace(-0.5, 1.0, len(EAUS)),
)

codes = st.sampled_from([10, 12]).flatmap(
    lambda count: st.lists(st.integers(-127, 127), min_size=count, max_size=count)
)


def test_golden_payload_has_not_changed() -> None:
    assert encode_thesis(GOLDEN, REFERENCE).hex() == "9b3fa264a59d014f5e6c"
    assert encode_thesis(GOLDEN, REFERENCE, with_eyelids=True).hex() == "9b3fa264a59d014f5e6c768a"


def test_the_reference_itself_is_all_zero_motion() -> None:
    payload = encode_thesis(FaceParameters(REFERENCE), REFERENCE)
    assert payload == bytes([128] * 6 + [1] + [128] * 3)


# Axis-angle vectors longer than half a turn come back as the other way round.
@given(codes.filter(lambda c: max(abs(x) for x in c[:3]) <= 100))
def test_codes_survive_the_parameters(values: list[int]) -> None:
    parameters = parameters_from_codes(np.array(values), REFERENCE)
    lids = len(values) == 12
    assert codes_from_parameters(parameters, REFERENCE, lids).tolist() == values


@given(
    st.tuples(*[st.floats(-50, 50)] * 3),
    st.tuples(*[st.floats(-250, 250)] * 2),
    st.floats(-0.9, 0.9),
    st.lists(st.floats(0, 1), min_size=4, max_size=4),
)
def test_the_nearest_code_is_taken(
    turn: tuple[float, ...], shift: tuple[float, ...], depth: float, eau: list[float]
) -> None:
    motion = np.array([*turn, *shift, depth])
    actuators = np.zeros(len(EAUS))
    actuators[: len(eau)] = eau
    face = FaceParameters(pose_from_motion(motion, REFERENCE), actuators)
    decoded = decode_thesis(encode_thesis(face, REFERENCE), REFERENCE)
    error = np.abs(motion_from_pose(decoded.pose, REFERENCE) - motion)
    for scale, value, miss in zip(THESIS_TABLE[:6], motion, error, strict=True):
        code = np.sqrt(scale.slope**2 + 4 * scale.curvature * abs(value)) + scale.curvature
        assert miss <= code / 2 + 1e-6, scale.name
    places = [EAU_INDEX[name] for name in THESIS_EAUS]
    assert np.abs(decoded.eau - actuators)[places].max() <= 0.5 / 127 + 1e-9


@given(st.tuples(*[st.floats(-20, 20)] * 5), st.floats(-0.5, 0.5))
def test_motion_is_invertible(five: tuple[float, ...], depth: float) -> None:
    motion = np.array([*five, depth])
    assert motion_from_pose(pose_from_motion(motion, REFERENCE), REFERENCE) == pytest.approx(
        motion, abs=1e-6
    )


def test_motion_out_of_range_is_clipped() -> None:
    far = Pose(REFERENCE.rotation, np.array([9000.0, -9000.0, 9000.0]))
    assert codes_from_parameters(FaceParameters(far), REFERENCE)[3:6].tolist() == [127, -127, 127]


def test_small_motion_is_precise_and_large_motion_possible() -> None:
    pose = parameters_from_codes(np.array([1, 0, 0, 1, 0, 1, 0, 0, 0, 0]), REFERENCE).pose
    turn = multiply(pose.rotation, conjugate(REFERENCE.rotation))
    assert np.degrees(np.linalg.norm(vector_from_quaternion(turn))) == pytest.approx(0.2, abs=0.01)
    for scale in THESIS_TABLE:
        assert 127 * scale.slope + 127**2 * scale.curvature == pytest.approx(scale.range)


def test_actuators_reach_their_ends() -> None:
    for sign in (-127, 127):
        eau = parameters_from_codes(np.full(12, sign), REFERENCE).eau
        for name in (*THESIS_EAUS, *LID_EAUS):
            limits = EAUS[EAU_INDEX[name]]
            expected = limits.low if sign < 0 else limits.high
            assert eau[EAU_INDEX[name]] == pytest.approx(expected)


@pytest.mark.parametrize(("lids", "expected"), [(False, 10), (True, 12)])
def test_a_payload_of_another_length_is_refused(lids: bool, expected: int) -> None:
    for length in set(range(14)) - {expected}:
        with pytest.raises(ProtocolError, match=f"expected {expected}"):
            decode_thesis(bytes([128] * length), REFERENCE, lids)


def test_eyelids_are_the_last_values() -> None:
    with_lids = encode_thesis(GOLDEN, REFERENCE, with_eyelids=True)
    assert with_lids[:10] == encode_thesis(GOLDEN, REFERENCE)
    face = decode_thesis(with_lids, REFERENCE, with_eyelids=True)
    for name in LID_EAUS:
        assert abs(face.eau[EAU_INDEX[name]] - GOLDEN.eau[EAU_INDEX[name]]) <= 0.375 / 127 + 1e-9


def test_the_unused_code_is_refused() -> None:
    with pytest.raises(ProtocolError, match="-128"):
        decode_thesis(bytes([128] * 9 + [0]), REFERENCE)


@pytest.mark.parametrize(
    ("frames", "fps", "expected"),
    [(0, (25, 1), 0), (1, (25, 1), 1), (3, (25, 1), 1), (4, (25, 1), 2), (250, (25, 1), 100),
     (382, (30000, 1001), 128), (300, (30, 1), 100), (2, (5, 1), 3)],
)  # fmt: skip
def test_samples_are_due_up_to_the_last_frame(
    frames: int, fps: tuple[int, int], expected: int
) -> None:
    assert thesis_sample_count(frames, *fps) == expected


def test_model_codes_are_nearest_and_clipped() -> None:
    assert codes_from_values(np.array([0.5, -9.0, 9.0]), AAU_STEP) == (32, -128, 127)
    assert codes_from_values(np.array([[-9.0]]), EAU_STEP, -127) == (-127,)
    assert values_from_codes((127, -127), EAU_STEP) == pytest.approx([1, -1])
