import numpy as np
import pytest

from encoder.residual.face_filling import face_filled


@pytest.mark.parametrize("tile", [8, 16])
def test_what_is_around_a_face_goes_on_in_it_and_stays_as_it_is(tile: int) -> None:
    difference = np.full((90, 110, 3), (40, -60, 90), np.float32)
    area = np.zeros((90, 110), np.float32)
    area[20:60, 30:80] = 1
    difference[area > 0] = 200
    before = difference.copy()

    filled = face_filled(difference, area, tile)

    np.testing.assert_array_equal(difference, before)
    np.testing.assert_array_equal(filled[area == 0], before[area == 0])
    # As around at the edge, and nothing where no mean reaches.
    np.testing.assert_allclose(filled[20, 31:79] - (40, -60, 90), 0, atol=1)
    assert not filled[39:41, 50:60].any()


def test_a_picture_without_a_face_is_left_alone() -> None:
    difference = np.random.default_rng(1).normal(0, 9, (40, 40, 3)).astype(np.float32)

    filled = face_filled(difference, np.zeros((40, 40), np.float32), 16)

    np.testing.assert_array_equal(filled, difference)
