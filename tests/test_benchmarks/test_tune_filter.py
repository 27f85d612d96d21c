"""Tuning scales the noises of filters that are made meanwhile, and of no others."""

import numpy as np
import pytest

from benchmarks.tune_filter import cells, scaled, tuned
from encoder.thesis import measurement_fusion
from encoder.thesis.ekf import FaceFilter, Measurements, ProcessNoise
from shared_model.arrays import Array
from shared_model.geometry import Camera, pose_from_euler

CAMERA = Camera(320, 240, 400.0)
POINTS = np.array([[0.0, 0.0, 80.0], [30.0, 20.0, 60.0], [-30.0, 20.0, 60.0], [0.0, -40.0, 70.0]])


def eau_after(q: float, r: float, measured: float = 1.0) -> float:
    """Where a filter that starts at 0 puts an actuator after one measurement of it."""
    with tuned(q, r):
        pose = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 600.0]))
        made = vars(measurement_fusion)["FaceFilter"](
            CAMERA, pose, np.zeros(1), len(POINTS), ProcessNoise(), None
        )
    made.predict(0.04)
    nothing: Array = np.full(len(POINTS), np.inf)
    pixels = np.zeros((len(POINTS), 2))
    found = made.update(
        Measurements(POINTS, pixels, nothing, np.array([measured]), np.array([0.3**2]))
    )
    return float(found.eau[0])


def test_large_r_follows_measurements_less_and_large_q_more() -> None:
    plain = eau_after(1, 1)
    assert 0 < eau_after(1, 4) < plain < eau_after(1, 0.25) < 1
    assert plain < eau_after(4, 1)
    assert vars(measurement_fusion)["FaceFilter"] is FaceFilter


def test_only_the_process_noise_is_scaled() -> None:
    noise = scaled(ProcessNoise(), 2.0)
    assert noise.eau_per_s == 2 * ProcessNoise().eau_per_s
    assert noise.velocities is True and scaled(3.0, 2.0) == 3.0


def test_a_line_is_the_mean_over_the_calls() -> None:
    rows = [{"rmse": [k * 1.0] * 3 + [k * 0.1] * 4, "lost": 0.5 * k} for k in (0, 1)]
    assert " | ".join(cells(rows)) == "0.50 | 0.50 | 0.50 | 0.050 | 0.050 | 0.050 | 0.050 | 25.0"


def test_what_is_measured_without_a_factor_is_as_it_was() -> None:
    pose = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 600.0]))
    plain = FaceFilter(CAMERA, pose, np.zeros(1), len(POINTS), ProcessNoise(), None)
    plain.predict(0.04)
    nothing = np.full(len(POINTS), np.inf)
    found = plain.update(
        Measurements(
            POINTS, np.zeros((len(POINTS), 2)), nothing, np.array([1.0]), np.array([0.3**2])
        )
    )
    assert eau_after(1, 1) == pytest.approx(float(found.eau[0]))
