"""Landmark fits recover known pose, actuators and identity."""

from dataclasses import replace

import numpy as np
import pytest
from heads import seen_points

from encoder.fitting import identity
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import fit_identity
from encoder.fitting.landmark_fit import (
    EAU_PRIOR_SIGMA,
    LandmarkModel,
    fit_landmarks,
    initial_parameters,
    landmark_model,
    observed_points,
    personalise,
    projection_jacobian,
    rotated_points,
)
from encoder.thesis.detection_measurement import animated_points
from shared_model.animate import Face, Identity
from shared_model.arrays import Array
from shared_model.geometry import (
    Camera,
    conjugate,
    euler_deg,
    matrix_from_quaternion,
    multiply,
    pixel_from_camera,
    pose_from_euler,
    quaternion_from_vector,
    vector_from_quaternion,
)
from shared_model.mesh import Head, generic_head
from shared_model.parameters import (
    AAUS,
    EAU_INDEX,
    EAUS,
    LID_EAUS,
    THESIS_EAUS,
    FaceParameters,
    clip_eau,
)

CAMERA = Camera(640, 480, 800.0)
SPOKEN = ("jaw_drop", "mouth_corners", "eyebrow_middle", "lip_stretch")


@pytest.fixture(scope="module")
def head() -> Head:
    return generic_head()


@pytest.fixture(scope="module")
def model(head: Head) -> LandmarkModel:
    return landmark_model(head)


def a_face(yaw: float, pitch: float, roll: float, **eau: float) -> FaceParameters:
    pose = pose_from_euler(pitch, yaw, roll, np.array([25.0, -15.0, 650.0]))
    values = np.zeros(len(EAUS))
    for name, value in eau.items():
        values[EAU_INDEX[name]] = value
    return FaceParameters(pose, values)


SENT = tuple(EAU_INDEX[name] for name in (*THESIS_EAUS, *LID_EAUS))


def angles(face: FaceParameters) -> Array:
    return np.array(euler_deg(face.pose))


def test_what_an_actuator_at_its_bound_leaves_is_explained_by_the_others(
    head: Head, model: LandmarkModel
) -> None:
    shut = a_face(4, 3, 0, lip_press=0.3, mouth_corners=0.2)
    points = seen_points(head, CAMERA, shut)
    # The chin higher than a shut jaw has it, as of somebody who pouts.
    opened = seen_points(
        head, CAMERA, a_face(4, 3, 0, lip_press=0.3, mouth_corners=0.2, jaw_drop=0.4)
    )
    points[:, :2] -= opened[:, :2] - points[:, :2]

    def cost(face: FaceParameters) -> float:
        rotated, _ = rotated_points(model, matrix_from_quaternion(face.pose.rotation), face.eau)
        pixels = pixel_from_camera(CAMERA, rotated + face.pose.translation_mm)
        target, sigma_px = observed_points(model, points)
        squares = np.square((target[:, :2] - pixels) / sigma_px).sum()
        return float(squares + np.square(face.eau / EAU_PRIOR_SIGMA).sum())

    jaw = EAU_INDEX["jaw_drop"]
    others = [number for number in range(len(EAUS)) if number != jaw]
    found = fit_landmarks(model, CAMERA, points, shut)
    held = fit_landmarks(model, CAMERA, points, shut, others)
    assert found.eau[jaw] == 0
    assert cost(found) < 1.02 * cost(held)


@pytest.mark.parametrize("turn", [(0, 0, 0), (20, -10, 5), (-30, 8, -20)])
def test_the_initial_pose_is_near(
    head: Head, model: LandmarkModel, turn: tuple[int, int, int]
) -> None:
    truth = a_face(*turn)
    found = initial_parameters(model, CAMERA, seen_points(head, CAMERA, truth))
    assert np.abs(angles(found) - angles(truth)).max() < 3
    shift = found.pose.translation_mm - truth.pose.translation_mm
    # Weak perspective takes the face's depth for the head's origin's, behind it.
    assert np.abs(shift[:2]).max() < 2 and abs(shift[2]) < 65
    assert not found.eau.any()


@pytest.mark.parametrize("turn", [(0, 0, 0), (20, -10, 5), (-30, 8, -20)])
def test_pose_and_actuators_are_recovered(
    head: Head, model: LandmarkModel, turn: tuple[int, int, int]
) -> None:
    truth = a_face(*turn, jaw_drop=0.6, mouth_corners=-0.4, eyebrow_middle=0.5, lip_stretch=0.3)
    points = seen_points(head, CAMERA, truth)
    found = fit_landmarks(
        model, CAMERA, points, initial_parameters(model, CAMERA, points), iterations=8
    )
    assert np.abs(angles(found) - angles(truth)).max() < 0.5
    assert np.abs(found.pose.translation_mm - truth.pose.translation_mm)[:2].max() < 0.5
    assert found.pose.translation_mm[2] == pytest.approx(650, abs=5)
    spoken = [EAU_INDEX[name] for name in SPOKEN]
    assert np.abs((found.eau - truth.eau)[spoken]).max() < 0.12


def test_noise_of_a_pixel_costs_little(head: Head, model: LandmarkModel) -> None:
    truth = a_face(12, 4, -3, jaw_drop=0.4)
    points = seen_points(head, CAMERA, truth, noise_px=1.0)
    found = fit_landmarks(model, CAMERA, points, initial_parameters(model, CAMERA, points))
    assert np.abs(angles(found) - angles(truth)).max() < 1
    assert found.eau[EAU_INDEX["jaw_drop"]] == pytest.approx(0.4, abs=0.1)


def test_inactive_actuators_keep_their_values(head: Head, model: LandmarkModel) -> None:
    truth = a_face(0, 0, 0, jaw_drop=0.7, mouth_corners=0.5)
    points = seen_points(head, CAMERA, truth)
    start = replace(initial_parameters(model, CAMERA, points), eau=np.full(len(EAUS), 0.05))
    found = fit_landmarks(model, CAMERA, points, start, active=[EAU_INDEX["jaw_drop"]])
    still = np.arange(len(EAUS)) != EAU_INDEX["jaw_drop"]
    assert (found.eau[still] == 0.05).all()
    assert found.eau[EAU_INDEX["jaw_drop"]] > 0.5


def test_actuators_stay_in_range_for_any_points(model: LandmarkModel) -> None:
    rng = np.random.default_rng(8)
    points = rng.uniform(50, 400, (468, 3))
    found = fit_landmarks(model, CAMERA, points, a_face(0, 0, 0))
    assert all(eau.low <= value <= eau.high for eau, value in zip(EAUS, found.eau, strict=True))
    assert np.isfinite(found.pose.translation_mm).all()


def test_several_frames_determine_the_identity(head: Head) -> None:
    aau = np.zeros(len(AAUS))
    aau[AAUS.index("facial_height")], aau[AAUS.index("nose_width")] = 1.0, -0.8
    truths = [a_face(yaw, pitch, 0) for yaw, pitch in ((-25, 0), (0, 8), (25, -5), (10, 0))]
    fitted = fit_identity(head, (640, 480), [seen_points(head, CAMERA, t, aau) for t in truths])
    for truth, found in zip(truths, fitted.frames, strict=True):
        assert np.abs(angles(found) - angles(truth)).max() < 2
    assert fitted.camera.focal_px == pytest.approx(CAMERA.focal_px, rel=0.15)
    # The shape is found, by AAUs and residual together.
    found_face = Face(head, fitted.identity).neutral
    generic = head.vertices
    truth_face = Face(head, Identity(aau, np.zeros_like(generic))).neutral
    known = head.triangles[head.network_triangles[head.network_triangles >= 0]]
    points = np.unique(known)
    left = np.linalg.norm((found_face - truth_face)[points], axis=1)
    before = np.linalg.norm((generic - truth_face)[points], axis=1)
    assert np.sqrt((left**2).mean()) < 0.6 * np.sqrt((before**2).mean())


@pytest.mark.parametrize("seed", range(1, 4))
def test_an_identity_is_found_within_the_steps(
    head: Head, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Where actuators rest, at which they begin to move the face otherwise: one more step
    changes nothing."""
    aau = np.random.default_rng(seed).uniform(-0.5, 0.5, len(AAUS))
    seen = [seen_points(head, CAMERA, a_face(-10, 5, 3), aau, noise_px=0.5)]
    fitted = fit_identity(head, (640, 480), seen)
    monkeypatch.setattr(identity, "ITERATIONS", identity.ITERATIONS + 1)
    longer = fit_identity(head, (640, 480), seen)
    assert np.array_equal(fitted.control_mm, longer.control_mm)
    assert np.array_equal(fitted.frames[0].eau, longer.frames[0].eau)


def test_the_number_of_threads_changes_no_identity(head: Head) -> None:
    truths = [a_face(yaw, 0, 0) for yaw in (-20, 5, 20)]
    seen = [seen_points(head, CAMERA, truth) for truth in truths]
    alone, beside = (fit_identity(head, (640, 480), seen, workers=count) for count in (1, 3))
    assert alone.camera == beside.camera
    assert np.array_equal(alone.control_mm, beside.control_mm)


def test_an_identity_is_recovered_from_an_initial_one(head: Head) -> None:
    aau = np.linspace(-0.8, 0.8, len(AAUS))
    truths = [a_face(yaw, 0, 0, jaw_drop=0.4) for yaw in (-20, -5, 8, 22)]
    seen = [seen_points(head, CAMERA, truth, aau, noise_px=0.3) for truth in truths]
    first = fit_identity(head, (640, 480), seen[:2])
    anew, near = (
        fit_identity(head, (640, 480), seen),
        fit_identity(head, (640, 480), seen, initial=first),
    )
    assert near.camera.focal_px == pytest.approx(anew.camera.focal_px, rel=0.02)
    off, gap = (
        Face(head, a.identity).neutral - Face(head, b.identity).neutral
        for a, b in ((near, anew), (first, anew))
    )
    assert (off**2).mean() < 0.4 * (gap**2).mean()
    for found, expected in zip(near.frames, anew.frames, strict=True):
        assert np.abs(angles(found) - angles(expected)).max() < 0.3


def test_personalised_points_are_those_of_the_personal_head(
    head: Head, model: LandmarkModel
) -> None:
    aau = np.linspace(-1, 1, len(AAUS))
    personal = personalise(model, aau, np.zeros((len(model.residual), 3)))
    vertices = Face(head, Identity(aau, np.zeros_like(head.vertices))).neutral
    corners = head.triangles[head.network_triangles[model.index]]
    expected = np.einsum("mc,mcd->md", head.network_weights[model.index], vertices[corners])
    assert np.allclose(personal.neutral, expected)


def test_the_projection_jacobian_equals_numeric_derivatives() -> None:
    points = np.array([(10.0, -20.0, 500.0), (-80.0, 60.0, 700.0)])
    moves = np.random.default_rng(4).normal(size=(5, 3, len(points)))
    for stated, move in zip(projection_jacobian(CAMERA, points, moves), moves, strict=True):
        step = 1e-4 * move.T
        ahead, behind = (pixel_from_camera(CAMERA, points + s * step) for s in (1, -1))
        assert np.allclose(stated.T, (ahead - behind) / 2e-4, atol=1e-4)


def test_the_sent_actuators_can_close_a_mouth_that_was_first_open(head: Head) -> None:
    truth = a_face(5, 3, 0, jaw_drop=0.3, upper_lip_raise=0.5, lower_lip_lower=0.3)
    points = seen_points(head, CAMERA, truth)
    all_move = fit_identity(head, (640, 480), [points])
    fitted = fit_identity(head, (640, 480), [points], active=SENT)
    eau = fitted.frames[0].eau
    unsent = sorted(set(range(len(EAUS))) - set(SENT))
    assert np.abs(eau[unsent]).max() < 0.01
    assert eau[EAU_INDEX["jaw_drop"]] > 0.3

    def apart_mm(found: IdentityFit) -> float:
        """Between the lips when all that is sent is at rest."""
        model = personalise(landmark_model(head), found.identity.aau, found.control_mm)
        eau = found.frames[0].eau.copy()
        eau[list(SENT)] = 0
        lips = animated_points(model, eau)[np.searchsorted(model.index, (13, 14))]
        return float(np.linalg.norm(lips[0] - lips[1]))

    assert apart_mm(fitted) < 1.6 < 5 < apart_mm(all_move)


def test_brows_raised_in_the_first_frame_become_part_of_the_shape(head: Head) -> None:
    raised = a_face(5, 0, 0, eyebrow_middle=0.5, eyebrow_inner=0.5)
    points = seen_points(head, CAMERA, raised)
    brows = [EAU_INDEX[name] for name in ("eyebrow_middle", "eyebrow_inner")]
    few, all_free = (fit_identity(head, (640, 480), [points], active=a) for a in (SENT, None))
    assert np.abs(few.frames[0].eau[brows]).max() < 0.1
    assert all_free.frames[0].eau[brows].max() > 0.15


def test_derivatives_of_rotated_points_equal_numeric_ones(model: LandmarkModel) -> None:
    rng = np.random.default_rng(3)
    eau = rng.uniform(0.2, 0.8, len(EAUS)) * rng.choice([-1, 1], len(EAUS))
    eau = np.where(clip_eau(eau) == eau, eau, -eau)
    rotation = matrix_from_quaternion(quaternion_from_vector(np.array([0.2, -0.3, 0.1])))
    _, moves = rotated_points(model, rotation, eau)
    for number, stated in enumerate(moves):
        ends = []
        for step in (1e-5, -1e-5):
            parameter = np.zeros(len(moves))
            parameter[number] = step
            turn = matrix_from_quaternion(quaternion_from_vector(parameter[:3]))
            points, _ = rotated_points(model, turn @ rotation, eau + parameter[6:])
            ends.append(points + parameter[3:6])
        assert np.allclose(stated.T, (ends[0] - ends[1]) / 2e-5, atol=1e-3)


def test_a_fit_converges_from_a_distant_face(head: Head, model: LandmarkModel) -> None:
    truth = a_face(-30, 10, 5, jaw_drop=0.6)
    found = fit_landmarks(model, CAMERA, seen_points(head, CAMERA, truth), a_face(35, -5, 0))
    near = fit_landmarks(model, CAMERA, seen_points(head, CAMERA, truth), truth)
    turn = multiply(found.pose.rotation, conjugate(near.pose.rotation))
    assert np.degrees(np.linalg.norm(vector_from_quaternion(turn))) < 1
    assert np.abs(found.eau - near.eau).max() < 0.1
