"""Closed eyelids of a caller who has not been seen with closed eyes.

An open eye folds its lids into a few pixels, which show lashes and the shadow of the crease.  Drawn
over a closed eye they would be a dark hole.  So the lids are drawn no darker, the more an eye
closes, than a share of the skin around it, and what they are lightened by has the colour of that
skin.  Lids that have been seen are lighter than that, and are drawn as they were sent.
"""

from functools import cache

import numpy as np

from protocol.pictures.picture_codec import to_luma
from runtime.image_ops import blurred
from shared_model.appearance import atlas_of
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.layers.head_motion import smoothstep
from shared_model.mesh import PARTS
from shared_model.parameters import LIDS
from shared_model.surround import head_with_surround

# Skin is averaged over about so much of the side of the atlas, what is drawn of a lid over so much.
REACH, NEAR = 1 / 10, 1 / 24
# A texel belongs to a lid, not at all to wholly, if closing the eye moves it by these shares of the
# motion of the lid's margin; from the third share on to the margin there are lashes, which may be
# darker by the fourth.
LID_SHARES, LASH_SHARE, LASH_LIGHT = (0.1, 0.4), 0.85, 0.5
# Texels that the lids move by more than this do not count as skin around them.
AROUND_SHARE = 0.03
# The actuator of an eyelid at which lightening begins, and at which a lid is at least as light as
# this share of the skin around it.
CLOSING, CLOSED, LEAST_LIGHT = 0.4, 0.75, 0.55


class ClosedLids:
    """The least luma of a caller's closed lids, from a mean texture (size, size, 3) BGR."""

    def __init__(self, mean: Picture) -> None:
        size = len(mean)
        self._area, weights, is_around = _lid_texels(size)
        known = is_around.astype(np.float32)[..., None]
        sums = blurred(np.concatenate([mean * known, known], 2), REACH * size)[self._area]
        around = sums[..., :3] / np.maximum(sums[..., 3:], np.float32(1e-3))
        luma = np.maximum(to_luma(around), np.float32(1))
        self._light = np.asarray(around / luma[..., None], np.float32)  # of luma 1
        self._weights, self._least = weights, np.asarray(LEAST_LIGHT * luma, np.float32)
        self._sigma = NEAR * size

    def lightened(self, texture: Picture, lids: Array) -> Picture:
        """A texture (size, size, 3) of the caller with its lids lightened.

        lids: (2,) actuators of the eyelids, left and right, 1 closed.
        """
        closed = smoothstep((lids - CLOSING) / (CLOSED - CLOSING)).astype(np.float32)
        if not closed.any():
            return texture
        drawn = texture[self._area].astype(np.float32)
        weight = np.tensordot(closed, self._weights, 1)
        luma = blurred(to_luma(drawn), self._sigma)
        missing = np.maximum(self._least - luma, 0) * weight
        drawn += missing[..., None] * self._light
        lightened = texture.copy()
        lightened[self._area] = np.minimum(drawn + np.float32(0.5), 255).astype(np.uint8)
        return lightened


@cache
def _lid_texels(size: int) -> tuple[tuple[slice, slice], Single, Mask]:
    """Where the lids are in an atlas of `size` texels a side.

    Returns the rows and columns around them; (2, rows, columns) how much a texel there belongs to
    the left and to the right lid, 0 to 1; (size, size) whether a texel is skin that hardly moves
    with them.
    """
    head = head_with_surround()
    atlas = atlas_of(head, size)
    motion = np.linalg.norm(head.eau_up[LIDS], axis=2)
    share = atlas.points((motion / motion.max(1, keepdims=True)).T)
    is_skin = head.parts[atlas.corners[:, 0]] == PARTS.index("skin")
    low, high = LID_SHARES
    lashes = smoothstep((share - LASH_SHARE) / (1 - LASH_SHARE))
    weights = np.zeros((2, size, size), np.float32)
    weights[:, atlas.rows, atlas.columns] = (
        smoothstep((share - low) / (high - low)) * (1 - (1 - LASH_LIGHT) * lashes)
    ).T * is_skin
    around = np.zeros((size, size), np.bool_)
    around[atlas.rows, atlas.columns] = is_skin & (share.max(1) < AROUND_SHARE)
    rows, columns = (np.flatnonzero(weights.any((0, axis))) for axis in (2, 1))
    area = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return area, weights[(slice(None), *area)], around
