"""Histograms of gradients: where edges are and how they run."""

import numpy as np

from aam.texture_frame import texture_frame
from benchmarks.validate_aam.units.gradient_histograms import ORIENTATIONS, gradient_histograms
from shared_model.arrays import Single

SIZE = 64
FRAME = texture_frame(SIZE, "full")


def striped(angle: float) -> Single:
    """Texels with waves along a direction, radians."""
    along = np.cos(angle) * FRAME.columns + np.sin(angle) * FRAME.rows
    return np.asarray(np.sin(along / 2), np.float32)


def cells(texture: Single) -> Single:
    return gradient_histograms(SIZE, "full", texture).reshape(-1, ORIENTATIONS)


def test_each_direction_of_an_edge_has_its_orientation() -> None:
    for number in range(ORIENTATIONS):
        found = cells(striped(np.pi * number / ORIENTATIONS))
        assert (found.argmax(1) == number).mean() > 0.9


def test_brightness_contrast_and_sign_do_not_matter() -> None:
    texture = striped(0.3) + 0.2 * striped(1.4)
    found = cells(texture)
    assert np.allclose(cells(-3 * texture), found, atol=1e-3)
    brighter = np.abs(cells(texture + 5) - found)
    # The step at the border of the face is no gradient of the face.
    assert brighter.max() < 1e-2


def test_a_flat_texture_has_no_orientation() -> None:
    assert not cells(np.zeros(len(FRAME.rows), np.float32)).any()
