"""The person's texture: recovers known motion under changed light, rejects other textures."""

from dataclasses import replace

import numpy as np
import pytest
from studio import BROW, CAMERA, FACE, HEAD, JAW, PLACE, REST, Studio, angle_error_deg, fitted

from encoder.appearance.photometric import retinex
from encoder.fitting.analysis_by_synthesis import RESIDUAL_SIGMA_GREY
from encoder.thesis.coarse_to_fine import (
    MIN_BROW_IMPROVEMENT,
    MIN_IMPROVEMENT,
    brow_starts,
    opposite_starts,
)
from encoder.thesis.person_texture import UPDATE_INTERVAL, PersonTexture
from shared_model.geometry import pose_from_euler
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio()


def texture_of(studio: Studio) -> PersonTexture:
    return PersonTexture(HEAD, FACE, CAMERA, studio.draw(REST), REST, 96)


def moved_face() -> FaceParameters:
    eau = np.zeros(len(EAUS))
    eau[JAW] = 0.3
    return FaceParameters(pose_from_euler(1.5, 2, -2, PLACE + np.array([2, -1.5, 6])), eau)


@pytest.mark.parametrize("light", [1.0, 0.75, 1.2])
def test_a_known_motion_is_recovered_under_any_light(studio: Studio, light: float) -> None:
    truth = moved_face()
    found = fitted(texture_of(studio), studio.draw(truth, light), REST, [JAW], 12)
    assert found.correlation > 0.9
    assert angle_error_deg(found.face, truth) < 0.7
    assert found.face.eau[JAW] == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize("side", [1, -1])
def test_a_shadow_over_half_the_face_misleads_luma_but_not_retinex(
    studio: Studio, side: int
) -> None:
    truth = moved_face()
    away_px = side * (np.arange(CAMERA.width) - CAMERA.width / 2)
    gain = 0.35 + 0.65 / (1 + np.exp(-np.clip(away_px / 8, -30, 30)))
    picture = np.asarray(np.rint(studio.draw(truth) * gain[None, :, None]), np.uint8)
    by_luma = texture_of(studio)
    by_retinex = PersonTexture(HEAD, FACE, CAMERA, studio.draw(REST), REST, 96, retinex)
    off = [
        angle_error_deg(fitted(texture, picture, REST, [JAW], 12).face, truth)
        for texture in (by_luma, by_retinex)
    ]
    assert off[1] < 2 and off[1] < 0.4 * off[0]


def test_inactive_actuators_keep_their_values(studio: Studio) -> None:
    brow = EAU_INDEX["eyebrow_inner"]
    start = replace(REST, eau=np.where(np.arange(len(EAUS)) == brow, 0.2, 0.0))
    found = fitted(texture_of(studio), studio.draw(moved_face()), start, [JAW], 6)
    assert found.face.eau[brow] == 0.2


def test_the_residual_sigma_is_the_noise_of_the_picture(studio: Studio) -> None:
    clear, texture = studio.draw(REST), texture_of(studio)
    grain = np.random.default_rng(4).normal(0, 25, clear.shape[:2])[..., None]
    noisy = np.clip(np.rint(clear + grain), 0, 255).astype(np.uint8)
    found = [fitted(texture, picture, REST, [], 2) for picture in (clear, noisy)]
    assert found[0].residual_sigma_grey < 0.7 * RESIDUAL_SIGMA_GREY
    assert found[1].residual_sigma_grey == pytest.approx(25, rel=0.2)
    assert found[1].residual_mse_grey2 > 5 * found[0].residual_mse_grey2


def test_the_initial_face_has_less_weight_in_clear_pictures(studio: Studio) -> None:
    """With low noise, an actuator is fitted nearly without bias to its initial value."""
    truth = replace(REST, eau=np.where(np.arange(len(EAUS)) == BROW, 0.5, 0.0))
    texture, picture = texture_of(studio), studio.draw(truth)

    def off() -> float:
        return float(abs(fitted(texture, picture, REST, [BROW], 12).face.eau[BROW] - 0.5))

    before, fit = off(), fitted(texture, picture, truth, [BROW], 2)
    for _ in range(50):
        texture.update_noise_level(fit)
    assert off() < before


@pytest.mark.parametrize("corners", [-0.5, 0.6])
def test_corners_on_the_wrong_side_of_rest_are_fitted_from_the_opposite_start(
    studio: Studio, corners: float
) -> None:
    index = EAU_INDEX["mouth_corners"]
    truth = replace(REST, eau=np.where(np.arange(len(EAUS)) == index, corners, 0.0))
    held = replace(REST, eau=-0.1 * truth.eau)
    texture, picture = texture_of(studio), studio.draw(truth)
    # An actuator that may not move is what a fit that halts is.
    halted = fitted(texture, picture, held, [], 6)
    [opposite] = opposite_starts(held, [index])
    freed = fitted(texture, picture, opposite, [index], 6)
    assert freed.residual_mse_grey2 < (1 - MIN_IMPROVEMENT) * halted.residual_mse_grey2
    assert freed.face.eau[index] == pytest.approx(corners, abs=0.06)


def test_brows_that_cancel_out_the_wrong_way_are_fitted_from_further_along(studio: Studio) -> None:
    brows = [EAU_INDEX["eyebrow_middle"], EAU_INDEX["eyebrow_inner"]]
    eau = np.zeros(len(EAUS))
    eau[brows] = -0.4, 0.6
    truth = replace(REST, eau=eau)
    texture, picture = texture_of(studio), studio.draw(truth)
    wrong = replace(truth, eau=np.where(np.isin(np.arange(len(EAUS)), brows), -eau / 2, eau))
    starts = brow_starts(wrong, brows)
    assert len(starts) == 2 and brow_starts(wrong, brows[:1]) == []
    halted = fitted(texture, picture, wrong, [], 3)
    fits = [fitted(texture, picture, start, brows, 3) for start in starts]
    best = min(fits, key=lambda fit: fit.residual_mse_grey2)
    assert best.residual_mse_grey2 < (1 - MIN_BROW_IMPROVEMENT) * halted.residual_mse_grey2
    assert np.abs(best.face.eau - eau)[brows].max() < 0.2


def test_a_wall_has_no_correlation_with_the_face(studio: Studio) -> None:
    random = np.random.default_rng(4)
    wall = random.integers(0, 256, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
    assert fitted(texture_of(studio), wall, REST, [JAW], 4).correlation < 0.4


def test_a_blank_picture_has_no_correlation_with_the_face(studio: Studio) -> None:
    blank = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
    for iterations in range(6):
        assert fitted(texture_of(studio), blank, REST, [JAW], iterations).correlation == 0


def test_a_face_outside_the_picture_has_no_correlation_and_raises_nothing(studio: Studio) -> None:
    away = replace(REST, pose=replace(REST.pose, translation_mm=np.array([4000.0, 0, 520])))
    found = fitted(texture_of(studio), studio.draw(REST), away, [JAW], 4)
    assert np.isfinite(found.face.pose.translation_mm).all()
    assert found.correlation < 0.4


def test_texels_hidden_in_the_first_frame_are_filled_as_the_head_turns(studio: Studio) -> None:
    texture = texture_of(studio)
    turned = replace(REST, pose=pose_from_euler(0, 32, 0, PLACE))
    picture = studio.draw(turned, 0.9)
    before = fitted(texture, picture, turned, [JAW], 3)
    for _ in range(UPDATE_INTERVAL):
        texture.update_template(picture, fitted(texture, picture, turned, [JAW], 3))
    again = fitted(texture, picture, turned, [JAW], 3)
    assert (
        again.correlation > max(0.85, before.correlation)
        and angle_error_deg(again.face, turned) < 1.5
    )
