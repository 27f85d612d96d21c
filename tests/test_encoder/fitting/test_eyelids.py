"""Eyelids follow the measured aperture, averaged with the fit of the texels."""

from dataclasses import replace

import numpy as np
import pytest
from heads import seen_points

from encoder.fitting.eyelids import (
    CLOSED_APERTURE,
    GAZE_EAUS,
    fit_with_eyelids,
    with_averaged_eyelids,
    with_measured_eyelids,
)
from encoder.fitting.landmark_fit import LandmarkModel, landmark_model
from shared_model.aperture_sheets import head_with_aperture_sheets
from shared_model.geometry import Camera, pose_from_euler
from shared_model.mesh import Head
from shared_model.parameters import EAU_INDEX, EAUS, LIDS, FaceParameters

CAMERA = Camera(640, 480, 800.0)


@pytest.fixture(scope="module")
def head() -> Head:
    return head_with_aperture_sheets()


@pytest.fixture(scope="module")
def model(head: Head) -> LandmarkModel:
    return landmark_model(head)


def a_face(*lids: float, gaze: float = 0.0) -> FaceParameters:
    eau = np.zeros(len(EAUS))
    eau[LIDS], eau[EAU_INDEX["gaze_vertical"]] = lids, gaze
    return FaceParameters(pose_from_euler(5, 15, -20, np.array([20.0, -10.0, 600.0])), eau)


@pytest.mark.parametrize("lids", [(0.0, 0.0), (0.3, 0.6), (-0.3, 0.0)])
def test_lids_have_the_measured_aperture(
    head: Head, model: LandmarkModel, lids: tuple[float, float]
) -> None:
    found = with_measured_eyelids(
        model, CAMERA, seen_points(head, CAMERA, a_face(*lids)), a_face(0.2, 0.1)
    )
    # The network leaves closed margins apart: what it sees as nearly closed is closed.
    wanted = [lid / (1 - CLOSED_APERTURE) if lid > 0 else lid for lid in lids]
    assert found.eau[LIDS] == pytest.approx(wanted, abs=0.12)


def test_nearly_touching_margins_are_closed_lids(head: Head, model: LandmarkModel) -> None:
    found = with_measured_eyelids(
        model, CAMERA, seen_points(head, CAMERA, a_face(0.85, 0.85)), a_face(0, 0)
    )
    assert found.eau[LIDS] == pytest.approx(1, abs=0.1)


def test_a_blink_does_not_change_the_gaze(head: Head, model: LandmarkModel) -> None:
    before = a_face(0, 0, gaze=-0.5)
    found = fit_with_eyelids(model, CAMERA, seen_points(head, CAMERA, a_face(0.8, 0.8)), before)
    assert not found.eau[GAZE_EAUS].any()
    assert (found.eau[LIDS] > 0.8).all()


def test_measured_and_fitted_lids_have_equal_weight() -> None:
    seen, refined = a_face(1.0, 0.0), replace(a_face(0.4, -0.3, gaze=0.2), modes=np.ones(2))
    found = with_averaged_eyelids(seen, refined)
    wanted = refined.eau.copy()
    wanted[LIDS] = 0.7, -0.15
    assert found.eau == pytest.approx(wanted)
    np.testing.assert_array_equal(found.modes, refined.modes)
