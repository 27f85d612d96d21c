"""Every source frame gets exactly one face, whatever packets are lost, late or repeated."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from played_samples import REFERENCE, control, face, jaw, model, play, sample

from decoder.playout.playout import FADE_S, Playout
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import thesis_sample_count
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, parse_packet, serialise
from shared_model.geometry import (
    interpolate,
    matrix_from_quaternion,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.parameters import AAUS, EAUS, FaceParameters, Pose

RATES = st.sampled_from(
    [(25, 1), (30000, 1001), (24000, 1001), (30, 1), (10, 1), (15, 2), (120, 1)]
)


@given(RATES, st.integers(1, 400), st.sets(st.integers(1, 150)), st.integers(0, 40))
def test_one_face_per_source_frame_under_any_loss(
    fps: tuple[int, int], frames: int, lost: set[int], start: int
) -> None:
    # Sequence numbers are ambiguous beyond 47 losses in a row.
    kept = [k for k in range(thesis_sample_count(frames, *fps)) if k not in lost or k % 40 == 0]
    total = start + frames
    packets = [model(fps, start), *map(sample, kept), control(ControlKind.END, total)]
    played = play(packets)
    assert [frame.index for frame in played] == list(range(total))
    # In a long gap the face waits before it moves on.
    shown = [frame for frame in played if not frame.lost]
    assert all(frame.frozen == (frame.index < start) for frame in shown)


def test_faces_between_samples_are_interpolated_at_their_own_time() -> None:
    played = play([model((25, 1)), *map(sample, range(5)), control(ControlKind.END, 11)])
    assert jaw(played) == pytest.approx([frame / 2.5 for frame in range(11)])


def test_frames_are_given_out_as_soon_as_the_next_sample_is_there() -> None:
    playout = Playout()
    assert play([model((30, 1))], playout) == []
    assert [f.index for f in play([sample(0)], playout)] == [0]
    assert [f.index for f in play([sample(1)], playout)] == [1, 2, 3]
    assert [f.index for f in play([sample(3)], playout)] == [4, 5, 6, 7, 8, 9]
    assert playout.lost == 1


def test_lost_packet_is_bridged_by_interpolation() -> None:
    played = play([model((10, 1)), sample(0), sample(1), sample(4), control(ControlKind.END, 5)])
    assert jaw(played) == pytest.approx([0, 1, 2, 3, 4])


def test_late_and_repeated_packets_change_nothing() -> None:
    playout = Playout()
    order = [0, 1, 3, 2, 3, 4, 4, 5]
    packets = [model((10, 1)), *map(sample, order), control(ControlKind.END, 6)]
    assert jaw(play(packets, playout)) == pytest.approx([0, 1, 2, 3, 4, 5])
    assert (playout.lost, playout.late) == (1, 3)


def test_last_face_is_repeated_to_the_end_of_the_call() -> None:
    played = play([model((30, 1)), sample(0), sample(1), control(ControlKind.END, 9)])
    assert [frame.index for frame in played] == list(range(9))
    assert jaw(played[3:]) == pytest.approx([1] * 6)


def test_call_without_end_stops_at_its_last_sample() -> None:
    playout = Playout()
    assert len(play([model((30, 1)), *map(sample, range(4))], playout)) == 10
    assert not playout.ended


def test_sequence_numbers_wrap_without_a_jump() -> None:
    played = play([model((10, 1)), *map(sample, range(150)), control(ControlKind.END, 150)])
    assert jaw(played) == pytest.approx(list(range(150)))


def test_lost_face_is_frozen_while_packets_continue() -> None:
    packets = [sample(0), sample(1), control(ControlKind.FACE_LOST, 2), sample(2), sample(3)]
    packets += [control(ControlKind.FACE_FOUND, 4), sample(4), control(ControlKind.END, 5)]
    played = play([model((10, 1)), *packets])
    assert jaw(played) == pytest.approx([0, 1, 1, 1, 4])
    assert [frame.frozen for frame in played] == [False, False, True, True, False]


def test_a_person_who_is_gone_fades_until_a_face_is_found() -> None:
    packets = [model(), sample(0), control(ControlKind.FACE_LOST, 1)]
    packets += [control(ControlKind.PERSON_GONE, 3), control(ControlKind.FACE_FOUND, 15)]
    played = play([*packets, control(ControlKind.END, 20)])
    presence = [frame.presence for frame in played]
    fade = [1 - (i + 1) / (FADE_S * 25) for i in range(7)]
    assert presence == pytest.approx([1.0] * 3 + fade + [0.0] * 5 + [1.0] * 5)


def test_lost_face_is_frozen_without_packets_for_longer_than_the_sequence_numbers() -> None:
    packets = [
        sample(0),
        sample(1),
        control(ControlKind.FACE_LOST, 2),
        control(ControlKind.FACE_FOUND, 100),
    ]
    packets += [sample(100), sample(101), control(ControlKind.END, 102)]
    playout = Playout()
    played = play([model((10, 1)), *packets], playout)
    assert [frame.index for frame in played] == list(range(102)) and playout.lost == 0
    # The face stays, then goes to rest.
    assert jaw(played)[:5] == pytest.approx([0, 1, 1, 1, 1])
    assert 0 < jaw(played)[8] < 1 and jaw(played)[14:98] == pytest.approx([0] * 84)
    assert jaw(played)[100:] == pytest.approx([100, 101])
    assert sum(frame.frozen for frame in played) == 98


def test_a_camera_that_is_off_changes_no_face() -> None:
    playout = Playout()
    packets = [sample(0), sample(1), control(ControlKind.CAMERA_OFF, 40), sample(2), sample(3)]
    played = play([model((10, 1)), *packets], playout)
    assert jaw(played) == pytest.approx([0, 1, 2, 3]) and playout.is_camera_off
    assert not any(frame.frozen for frame in played)
    assert play([control(ControlKind.CAMERA_ON, 90)], playout) == []
    assert not playout.is_camera_off


def test_call_that_ends_without_a_face_holds_the_last_one() -> None:
    packets = [sample(0), control(ControlKind.FACE_LOST, 1), control(ControlKind.END, 30)]
    played = play([model((10, 1)), *packets])
    assert [frame.frozen for frame in played] == [False] + [True] * 29


def test_joining_late_starts_at_the_first_sample_that_comes() -> None:
    playout = Playout()
    packets = [model((30, 1)), sample(40), sample(41), control(ControlKind.END, 5000)]
    played = play(packets, playout)
    assert playout.joined_late and playout.ended and playout.lost == 0
    assert len(played) == 4 and jaw(played)[::3] == pytest.approx([40, 41])


def test_frames_before_the_model_are_counted_not_shown() -> None:
    playout = Playout()
    assert play([sample(0), model(), model((10, 1)), sample(1)], playout)
    assert playout.unusable == 1 and playout.model is not None
    assert playout.model.call.fps == 25


def test_a_call_that_never_had_a_face_has_no_frames() -> None:
    assert play([model(), control(ControlKind.END, 300)]) == []


@pytest.mark.parametrize(
    "packets",
    [
        [sample(0), control(ControlKind.END, 2**28 - 1)],
        [sample(0), control(ControlKind.FACE_LOST, 2**28 - 1)],
    ],
)
def test_no_packet_makes_the_decoder_draw_without_bound(packets: list[bytes]) -> None:
    with pytest.raises(ProtocolError, match="limit 600 s"):
        play([model((10, 1)), *packets])


def test_start_frame_is_bounded_too() -> None:
    with pytest.raises(ProtocolError, match="limit 600 s"):
        play([model((10, 1), start=2**28 - 1), sample(0)])


@pytest.mark.parametrize("data", [b"", b"\xc0", bytes([1]) + bytes(10), bytes([1, 1, 2])])
def test_damaged_packets_raise_protocol_error_and_harm_nothing(data: bytes) -> None:
    playout = Playout()
    play([model((10, 1)), sample(0)], playout)
    with pytest.raises(ProtocolError):
        play([data], playout)
    assert jaw(play([sample(1), control(ControlKind.END, 2)], playout)) == pytest.approx([1])


vectors = st.tuples(*[st.floats(-1.5, 1.5)] * 3).map(np.array)


@given(vectors, vectors, st.floats(0, 1))
def test_rotation_runs_along_the_shortest_arc_at_even_speed(
    first: np.ndarray, second: np.ndarray, share: float
) -> None:
    a, b = (
        FaceParameters(Pose(quaternion_from_vector(w), np.array([0.0, 0, 500])))
        for w in (first, second)
    )
    between = interpolate(a, b, share)

    def angle(p: FaceParameters, q: FaceParameters) -> float:
        matrix = matrix_from_quaternion(p.pose.rotation).T @ matrix_from_quaternion(q.pose.rotation)
        return float(np.arccos(np.clip((np.trace(matrix) - 1) / 2, -1, 1)))

    assert angle(a, between) == pytest.approx(share * angle(a, b), abs=1e-6)
    assert angle(between, b) == pytest.approx((1 - share) * angle(a, b), abs=1e-6)


def test_interpolation_meets_both_ends() -> None:
    ends = face(3), face(9)
    for share, end in zip((0.0, 1.0), ends, strict=True):
        between = interpolate(*ends, share)
        np.testing.assert_allclose(between.pose.translation_mm, end.pose.translation_mm)
        np.testing.assert_allclose(between.eau, end.eau)
        turn = vector_from_quaternion(between.pose.rotation)
        np.testing.assert_allclose(turn, vector_from_quaternion(end.pose.rotation), atol=1e-12)


def update(layer: int, sequence: int, start: int, width: int = 176) -> bytes:
    call = CallParameters("thesis", width, 144, 10, 1, 300.0, start_frame=start)
    rotation, translation = map(tuple, (REFERENCE.rotation, REFERENCE.translation_mm))
    aau, eau = (layer, *[0] * (len(AAUS) - 1)), (0,) * len(EAUS)
    packet = ModelPacket(
        call,
        aau,
        rotation,
        translation,
        eau,
        version=layer,
        version_count=layer + 1,
        sequence=sequence,
    )
    return serialise(packet)


def layers(packets: list[bytes], playout: Playout) -> list[int]:
    """Which layer the model of each frame has."""
    found = []
    for data in packets:
        for _ in playout.receive(parse_packet(data)):
            assert playout.model is not None
            found.append(playout.model.version)
    return found


def test_an_update_holds_from_the_packet_it_names() -> None:
    playout = Playout()
    packets = [model((10, 1)), *map(sample, range(3)), update(1, 5, 5), *map(sample, range(3, 8))]
    assert layers(packets, playout) == [0] * 5 + [1] * 3


def test_an_update_takes_effect_even_if_its_first_packets_are_lost() -> None:
    playout = Playout()
    packets = [model((10, 1)), sample(0), update(1, 2, 2), sample(1), sample(4)]
    assert layers(packets, playout)[-1] == 1
    assert playout.lost == 2


def test_of_repeated_and_old_updates_the_newest_counts() -> None:
    playout = Playout()
    packets = [model((10, 1)), sample(0), update(2, 3, 3), update(1, 2, 2), update(2, 3, 3)]
    assert layers([*packets, *map(sample, range(1, 5))], playout) == [0, 0, 0, 2, 2]


def test_an_update_of_another_call_is_refused() -> None:
    playout = Playout()
    play([model((10, 1)), sample(0)], playout)
    with pytest.raises(ProtocolError, match="another call"):
        play([update(1, 2, 2, width=352)], playout)
    assert len(play([sample(1)], playout)) == 1


def test_a_late_joiner_counts_from_the_update() -> None:
    playout = Playout()
    played = play([update(3, 60, 100), sample(1), sample(2)], playout)
    assert playout.joined_late
    # Packet 60 was of frame 100; the sequence has gone round since.
    assert [frame.index for frame in played] == [105, 106]
