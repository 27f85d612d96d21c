"""The filter: derivatives against numeric ones, synthetic ground truth, occlusion, outliers."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from encoder.thesis.ekf import Estimate, FaceFilter, Measurements, ProcessNoise
from encoder.thesis.measurement_model import Projection, lowe, perspective
from shared_model.geometry import (
    Camera,
    euler_deg,
    matrix_from_quaternion,
    pixel_from_head,
    pose_from_euler,
    quaternion_from_vector,
)
from shared_model.parameters import Pose

FPS = 25
TRUE = Camera(640, 480, 640.0)
NOISE_PX = 0.5
SEEN = np.full(30, NOISE_PX**2)
POINTS = np.random.default_rng(7).uniform([-70, -70, 0], [70, 70, 120], (30, 3))

angle = st.floats(-40, 40)


def pose_at(frame: int) -> Pose:
    """A head that turns by up to 25 degrees and moves by several cm, as in thesis 5.3.1."""
    s = frame / FPS
    place = [40 * np.sin(0.8 * s), 25 * np.cos(0.6 * s), 600 + 60 * np.sin(0.5 * s)]
    angles = 12 * np.sin(1.3 * s), 25 * np.sin(0.9 * s), 10 * np.sin(0.7 * s + 1)
    return pose_from_euler(*angles, np.array(place))


def eau_at(frame: int) -> np.ndarray:
    return np.asarray(0.5 * np.sin(frame / 10 + np.arange(4)))


def started(
    motion: ProcessNoise, projection: Projection = perspective, focal_error: float = 1.15
) -> FaceFilter:
    """A filter that begins with a focal length, hence a depth, wrong by 15 %."""
    pose = pose_at(0)
    wrong = Pose(pose.rotation, pose.translation_mm * [1, 1, focal_error])
    camera = Camera(640, 480, TRUE.focal_px * focal_error)
    return FaceFilter(camera, wrong, np.zeros(4), len(POINTS), motion, projection=projection)


def track(
    filter_: FaceFilter, rng: np.random.Generator, frames: int, outliers: float = 0.1
) -> Iterator[tuple[int, Estimate]]:
    for frame in range(1, frames):
        pixels = pixel_from_head(TRUE, pose_at(frame), POINTS) + rng.normal(0, NOISE_PX, (30, 2))
        pixels[rng.random(30) < outliers] += rng.normal(0, 20, 2)
        hidden = rng.random(30) < 0.2
        pixels[hidden] = np.nan
        variance = np.where(hidden, np.inf, SEEN)
        filter_.predict(1 / FPS)
        eau = eau_at(frame) + rng.normal(0, 0.05, 4)
        yield (
            frame,
            filter_.update(Measurements(POINTS, pixels, variance, eau, np.full(4, 0.05**2))),
        )


@given(pitch=angle, yaw=angle, roll=angle, x=st.floats(-100, 100), y=st.floats(-80, 80))
@pytest.mark.parametrize("projection", [perspective, lowe], ids=["perspective", "lowe"])
def test_state_and_pose_convert_both_ways(
    projection: Projection, pitch: float, yaw: float, roll: float, x: float, y: float
) -> None:
    pose = pose_from_euler(pitch, yaw, roll, np.array([x, y, 600.0]))
    rotation, position = projection.state_from_pose(pose, 700.0)
    back = projection.pose_from_state(rotation, position, 700.0)
    assert back.translation_mm == pytest.approx(pose.translation_mm)
    assert abs(back.rotation @ pose.rotation) == pytest.approx(1)


@pytest.mark.parametrize(
    ("projection", "shift_mm", "tolerance_px"),
    [(perspective, 250, 1e-9), (lowe, 0, 1e-9), (lowe, 30, 1.0), (lowe, 100, 4.0)],
)
def test_projection_agrees_with_the_camera(
    projection: Projection, shift_mm: float, tolerance_px: float
) -> None:
    pose = pose_from_euler(5, -12, 8, np.array([shift_mm, -shift_mm / 2, 620]))
    rotation, position = projection.state_from_pose(pose, TRUE.focal_px)
    turned = POINTS @ matrix_from_quaternion(rotation).T
    pixels, _ = projection.project(turned, position, TRUE.focal_px)
    expected = pixel_from_head(TRUE, pose, POINTS) - TRUE.centre
    assert np.abs(pixels - expected).max() < tolerance_px


@given(pitch=angle, yaw=angle, roll=angle, x=st.floats(-150, 150), y=st.floats(-100, 100))
@pytest.mark.parametrize("projection", [perspective, lowe], ids=["perspective", "lowe"])
def test_jacobian_equals_numeric_derivatives(
    projection: Projection, pitch: float, yaw: float, roll: float, x: float, y: float
) -> None:
    rotation = pose_from_euler(pitch, yaw, roll, np.zeros(3)).rotation
    state = np.array([x, y, 600.0, 0, 0, 0, 650.0])

    def project(state: np.ndarray) -> np.ndarray:
        turn = matrix_from_quaternion(quaternion_from_vector(state[3:6]))
        turned = POINTS @ matrix_from_quaternion(rotation).T @ turn.T
        return projection.project(turned, state[:3], state[6])[0]

    _, J = projection.project(POINTS @ matrix_from_quaternion(rotation).T, state[:3], 650.0)
    for column, step in enumerate([1e-3] * 3 + [1e-6] * 3 + [1e-3]):
        nudge = step * np.eye(7)[column]
        numeric = (project(state + nudge) - project(state - nudge)) / (2 * step)
        assert J[:, :, column] == pytest.approx(numeric, rel=1e-5, abs=1e-5)


def test_lowe_jacobian_is_table_4_2() -> None:
    (x, y, z), t_z, f = (30.0, -20.0, 50.0), 600.0, 700.0
    d = 1 / (z + t_z)
    _, J = lowe.project(np.array([[x, y, z]]), np.array([5.0, 6.0, t_z]), f)
    u = [1, 0, -f * d**2 * x, -f * d**2 * x * y, f * d * (z + d * x**2), -f * d * y, d * x]
    v = [0, 1, -f * d**2 * y, -f * d * (z + d * y**2), f * d**2 * x * y, f * d * x, d * y]
    assert J[0] == pytest.approx(np.array([u, v]))


@pytest.mark.parametrize(
    ("velocities", "projection", "tolerance_deg"),
    [(True, perspective, 0.4), (True, lowe, 0.5), (False, perspective, 0.5), (False, lowe, 0.5)],
)
def test_pose_focal_length_and_actuators_are_recovered(
    velocities: bool, projection: Projection, tolerance_deg: float
) -> None:
    filter_ = started(ProcessNoise(velocities=velocities), projection)
    angles, eaus = [], []
    for frame, estimate in track(filter_, np.random.default_rng(1), 500):
        if frame > 100:
            angles.append(np.subtract(euler_deg(estimate.pose), euler_deg(pose_at(frame))))
            eaus.append(estimate.eau - eau_at(frame))
    assert np.sqrt(np.mean(np.square(angles), axis=0)).max() < tolerance_deg
    assert np.sqrt(np.mean(np.square(eaus))) < 0.05
    assert estimate.camera.focal_px == pytest.approx(TRUE.focal_px, rel=0.03)
    # Depth and focal length trade off; their ratio, the face's scale, must hold.
    scale = estimate.pose.translation_mm[2] / estimate.camera.focal_px
    assert scale == pytest.approx(pose_at(499).translation_mm[2] / TRUE.focal_px, rel=0.02)


def test_prediction_extrapolates_the_velocity() -> None:
    errors = {}
    for velocities in (True, False):
        filter_, misses = started(ProcessNoise(velocities=velocities), focal_error=1.0), []
        for frame, _ in track(filter_, np.random.default_rng(2), 200, outliers=0.0):
            ahead = filter_.estimate.pose
            if frame > 30:
                next_pixels = pixel_from_head(TRUE, pose_at(frame + 1), POINTS)
                ahead = predicted(filter_)
                camera = filter_.estimate.camera
                misses.append(np.abs(pixel_from_head(camera, ahead, POINTS) - next_pixels).mean())
        errors[velocities] = np.mean(misses)
    assert errors[True] < 0.7 * errors[False]


def predicted(filter_: FaceFilter) -> Pose:
    """The prediction, with the filter left unchanged."""
    from copy import deepcopy

    return deepcopy(filter_).predict(1 / FPS).pose


def test_occluded_points_are_ignored_until_they_are_measured_again() -> None:
    filter_ = started(ProcessNoise(), focal_error=1.0)
    for _, _ in track(filter_, np.random.default_rng(3), 60, outliers=0.0):
        pass
    before = filter_.predict(1 / FPS)
    unseen = np.full(30, np.inf)
    pixels = np.full((30, 2), np.nan)
    nothing = filter_.update(Measurements(POINTS, pixels, unseen, np.zeros(4), np.full(4, np.inf)))
    assert nothing.pose.translation_mm == pytest.approx(before.pose.translation_mm)
    assert nothing.eau == pytest.approx(before.eau, abs=1e-6)
    assert not nothing.inliers.any()
    filter_.predict(1 / FPS)
    pixels = pixel_from_head(TRUE, pose_at(61), POINTS)
    back = filter_.update(Measurements(POINTS, pixels, SEEN, eau_at(61), np.full(4, 0.01)))
    assert back.inliers.all()
    assert euler_deg(back.pose) == pytest.approx(euler_deg(pose_at(61)), abs=1)


def test_gross_outliers_are_rejected() -> None:
    filter_ = started(ProcessNoise(), focal_error=1.0)
    for _, _ in track(filter_, np.random.default_rng(4), 60, outliers=0.0):
        pass
    filter_.predict(1 / FPS)
    pixels = pixel_from_head(TRUE, pose_at(60), POINTS)
    pixels[:12] += [25.0, -10.0]
    estimate = filter_.update(Measurements(POINTS, pixels, SEEN, eau_at(60), np.full(4, 0.01)))
    assert not estimate.inliers[:12].any() and estimate.inliers[12:].all()
    assert euler_deg(estimate.pose) == pytest.approx(euler_deg(pose_at(60)), abs=1)


def test_a_jump_is_tracked_and_raises_the_normalised_innovation() -> None:
    filter_ = started(ProcessNoise(), focal_error=1.0)
    calm = max(
        e.normalised_innovation
        for _, e in track(filter_, np.random.default_rng(5), 60, outliers=0.0)
    )
    jumped = pose_from_euler(0, -20, 10, np.array([150.0, 20, 620]))
    pixels = pixel_from_head(TRUE, jumped, POINTS)
    filter_.predict(1 / FPS)
    first = filter_.update(Measurements(POINTS, pixels, SEEN, eau_at(60), np.full(4, 0.01)))
    assert first.normalised_innovation > 3 * calm
    for _ in range(10):
        filter_.predict(1 / FPS)
        last = filter_.update(Measurements(POINTS, pixels, SEEN, eau_at(60), np.full(4, 0.01)))
    assert euler_deg(last.pose) == pytest.approx((0, -20, 10), abs=1.5)


def test_covariance_stays_symmetric_and_positive() -> None:
    filter_ = started(ProcessNoise())
    for _, _ in track(filter_, np.random.default_rng(6), 300):
        pass
    P = filter_.covariance
    assert pytest.approx(P.T, rel=1e-6, abs=1e-9) == P
    assert np.linalg.eigvalsh(P).min() > 0


@pytest.mark.parametrize("wrong", range(5))
def test_wrong_shapes_are_named(wrong: int) -> None:
    filter_ = started(ProcessNoise())
    shapes = [(30, 3), (30, 2), (30,), (4,), (4,)]
    arrays = [np.ones(shape) for shape in shapes]
    arrays[wrong] = arrays[wrong][..., None]
    name = ("points_mm", "pixels", "variance_px2", "eau", "eau_variance")[wrong]
    with pytest.raises(ValueError, match=name):
        filter_.update(Measurements(*arrays))


def test_a_nonpositive_time_step_is_refused() -> None:
    with pytest.raises(ValueError, match="elapsed_s"):
        started(ProcessNoise()).predict(0.0)
