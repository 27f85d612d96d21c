"""Eyelids that were never seen closed are drawn as skin."""

import numpy as np
import pytest

from decoder.rendering.closed_lids import ClosedLids
from shared_model.appearance import atlas_of
from shared_model.arrays import Mask, Picture
from shared_model.mesh import PARTS
from shared_model.parameters import LIDS
from shared_model.surround import head_with_surround

SIZE = 96
SKIN, DARK = (60, 90, 150), (12, 12, 14)


def lid_texels(side: int, least: float) -> Mask:
    """(SIZE, SIZE) the texels that move with the left or right lid by `least` of its margin."""
    head, texels = head_with_surround(), np.zeros((SIZE, SIZE), np.bool_)
    atlas = atlas_of(head, SIZE)
    motion = np.linalg.norm(head.eau_up[LIDS[side]], axis=1)
    is_lid = atlas.points(motion[:, None] / motion.max())[:, 0] > least
    texels[atlas.rows[is_lid], atlas.columns[is_lid]] = True
    return texels


def middle_of(side: int) -> Mask:
    """(SIZE, SIZE) the skin in the middle of a lid."""
    head, is_skin = head_with_surround(), np.zeros((SIZE, SIZE), np.bool_)
    atlas = atlas_of(head, SIZE)
    is_skin[atlas.rows, atlas.columns] = head.parts[atlas.corners[:, 0]] == PARTS.index("skin")
    return is_skin & lid_texels(side, 0.5) & ~lid_texels(side, 0.8)


LEFT, RIGHT = 0, 1


@pytest.fixture(scope="module")
def face() -> Picture:
    """A face whose lids are dark, as an open eye shows them."""
    texture = np.zeros((SIZE, SIZE, 3), np.uint8) + np.array(SKIN, np.uint8)
    texture[lid_texels(LEFT, 0.1) | lid_texels(RIGHT, 0.1)] = DARK
    return texture


def test_a_closed_dark_lid_becomes_skin_and_the_open_eye_stays(face: Picture) -> None:
    drawn = ClosedLids(face).lightened(face, np.array([1.0, 0.0]))
    blue, green, red = np.median(drawn[middle_of(LEFT)], axis=0)
    assert red > 45 and red > green + 10 > blue + 12
    np.testing.assert_array_equal(drawn[middle_of(RIGHT)], face[middle_of(RIGHT)])


def test_open_eyes_and_lids_as_light_as_skin_stay(face: Picture) -> None:
    lids = ClosedLids(face)
    assert lids.lightened(face, np.array([0.2, -0.5])) is face
    skin = np.zeros_like(face) + np.array(SKIN, np.uint8)
    np.testing.assert_array_equal(lids.lightened(skin, np.ones(2)), skin)


def test_away_from_the_lids_nothing_changes(face: Picture) -> None:
    drawn = ClosedLids(face).lightened(face, np.ones(2))
    changed = (drawn != face).any(2)
    assert changed[middle_of(LEFT) | middle_of(RIGHT)].all()
    assert not changed[SIZE // 2 :].any()
