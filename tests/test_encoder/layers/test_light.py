"""The light on the layers: found, followed, and taken for nothing else."""

import cv2
import numpy as np
import pytest

from encoder.layers.light import fit_light, lit, unlit
from shared_model.arrays import Single
from shared_model.layers.light import Light, light_of

EVERYWHERE = np.ones((60, 80), np.float32)


def scene(seed: int = 0) -> Single:
    noise = np.random.default_rng(seed).normal(0, 1, EVERYWHERE.shape)
    return np.asarray(100 + 120 * cv2.GaussianBlur(noise, (0, 0), 3.0), np.float32)


@pytest.mark.parametrize("light", [Light(1.4, 20.0), Light(0.3, -60.0), Light(8.0, 700.0)])
def test_a_light_is_found(light: Light) -> None:
    found = light_of(fit_light(scene(), lit(scene(), light), EVERYWHERE))
    assert found.gain == pytest.approx(light.gain, rel=0.05)
    assert np.abs(lit(scene(), found) - lit(scene(), light)).mean() < 1 + 0.02 * abs(light.offset)


def test_somebody_who_comes_in_does_not_count() -> None:
    expected = lit(scene(), Light(1.2, 15.0))
    changed = expected.copy()
    changed[20:50, 10:30] = 250
    found = light_of(fit_light(scene(), changed, EVERYWHERE))
    assert np.abs(lit(scene(), found) - expected).mean() < 2


def test_another_view_is_no_light() -> None:
    assert not fit_light(scene(), scene(), EVERYWHERE).any()
    assert not fit_light(scene(), np.roll(scene(), 9, 1), EVERYWHERE).any()
    assert not fit_light(scene(), scene(1), EVERYWHERE).any()


def test_a_picture_without_contrast_has_no_gain_beyond_the_largest() -> None:
    black, room = np.zeros_like(EVERYWHERE), scene()
    found = light_of(fit_light(black, room, EVERYWHERE))
    assert 0 < found.gain <= 20 and np.isfinite(found.offset)


def test_what_a_light_does_is_undone() -> None:
    light = Light(2.5, -30.0)
    np.testing.assert_allclose(unlit(lit(scene(), light), light), scene(), atol=1e-3)


def test_missing_coefficients_change_nothing_and_a_gain_is_never_negative() -> None:
    assert light_of(np.zeros(0)) == Light(1.0, 0.0)
    assert light_of(np.array([-1000.0])) == Light(0.0, 0.0)
