"""The error of a decoded call in rings along the person's outline."""

import numpy as np
import pytest

from benchmarks.outline_error.__main__ import RINGS, lines, ring_psnr_db, signed_distance


def test_each_ring_has_its_own_error() -> None:
    person = np.zeros((80, 100), np.bool_)
    person[:, 50:] = True
    error = {(0, 6): 16, (6, 12): 8, (12, 24): 4, (-6, 0): 32, (-12, -6): 2, (-24, -12): 1}
    original, distance = np.full((80, 100, 3), 100, np.uint8), signed_distance(person)
    copy = original.copy()
    for (low, high), grey in error.items():
        copy[(distance > low) & (distance <= high)] += np.uint8(grey)
    # The face, of which the rings leave out the worst.
    face = np.zeros_like(person)
    copy[20:40, 52:60] = 255
    face[20:40, 52:60] = True
    figures = ring_psnr_db([(original, copy)], lambda _: face, lambda _: person)
    expected = [20 * np.log10(255 / error[ring]) for ring in RINGS]
    assert figures == pytest.approx(expected, abs=0.1)
    assert lines(figures)[3] == "inside 0 to 6 px: 18.0 dB"


def test_without_a_person_there_is_no_ring() -> None:
    picture = np.zeros((20, 30, 3), np.uint8)
    figures = ring_psnr_db(
        [(picture, picture)], lambda _: None, lambda _: np.zeros((20, 30), np.bool_)
    )
    assert np.isnan(figures).all()
