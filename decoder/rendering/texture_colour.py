"""Colours of a texture, completed from its luma where no mode has sent them.

At a few hundred bytes a mode holds hardly more than luma.  Taken as grey, it would leave a lid that
closes over a dark eye grey, and skin that comes into the light blue or green.  Light and relief
change the colour of skin and hair in proportion to their luma.  So colours that a mode lacks follow
its luma, and a texture of mean and modes takes no colour that the mean does not have nearby.  Luma
stays as it was sent.
"""

import cv2
import numpy as np

from protocol.pictures.picture_codec import LUMA_BGR, from_planes, to_planes
from runtime.image_ops import blurred
from runtime.jit import jit
from shared_model.appearance import atlas_of
from shared_model.arrays import Integers, Picture, Single
from shared_model.mesh import PARTS
from shared_model.surround import head_with_surround

# Parts of the head, each with colours of its own around a texel; all others are left as they are.
COLOURED_PARTS = ("skin", "surround")
# Colours are averaged over about so much of the side of the atlas; those within so much of it are
# taken for the same thing.
REACH, NEAR = 1 / 12, 1 / 48
# Luma no less than this divides colour differences.
MIN_LUMA = 12.0
# Where luma is less than this share of that around, the mean's colour counts for nothing.
BRIGHT = 0.6
# The share of the colour that follows luma: there, and elsewhere, where less is to be mended.
SHARE, BRIGHT_SHARE = 0.6, 0.3
# Where colour of this share of that has been sent within some texels, none is added.
SENT_SHARE, SENT_REACH = 0.5, 2.0
# Luma as coarse as colour is coded.
COARSE = 1.0
# By how many grey levels colour differences may leave what is nearby.
SLACK_GREY = 2.0
# No limit.
FREE = 1e3
BLUE, GREEN, RED = map(np.float32, LUMA_BGR)


class LocalColours:
    """The colours of a mean texture (size, size, 3) uint8 BGR around each of its texels."""

    def __init__(self, mean: Picture) -> None:
        size = len(mean)
        part_of = _parts(size)
        planes = to_planes(mean.astype(np.float32), 1.0)
        self._expected: Single = np.zeros((size, size, 2), np.float32)
        low = np.full((size, size, 2), -FREE, np.float32)
        high = np.full((size, size, 2), FREE, np.float32)
        coarse = blurred(planes, COARSE)
        own = _ratio(coarse)
        kernel = np.ones((2 * round(NEAR * size) + 1,) * 2, np.uint8)
        for name in COLOURED_PARTS:
            is_part = part_of == PARTS.index(name)
            area = blurred(is_part.astype(np.float32), REACH * size)
            averaged = blurred(planes * is_part[..., None], REACH * size)
            averaged /= np.maximum(area, np.float32(1e-3))[..., None]
            around = _ratio(averaged)
            is_seen = is_part & (coarse[..., 0] > BRIGHT * averaged[..., 0])
            share = np.where(is_seen, BRIGHT_SHARE, SHARE).astype(np.float32)
            expected = blurred(share, SENT_REACH)[..., None] * around
            self._expected[is_part] = expected[is_part]
            usual = SHARE * around
            seen = np.where(is_seen[..., None], own, usual)
            low[is_part] = np.minimum(cv2.erode(seen, kernel), usual)[is_part]
            high[is_part] = np.maximum(cv2.dilate(seen, kernel), usual)[is_part]
        self._mean = mean.astype(np.float32).reshape(-1, 3)
        self._low, self._high = low.reshape(-1, 2), high.reshape(-1, 2)

    def complete(self, mode: Single) -> Single:
        """A mode (size, size, 3), BGR, with colour where none has been sent."""
        planes = to_planes(mode, 1.0)
        expected = self._expected * blurred(planes[..., 0], COARSE)[..., None]
        sent = blurred(_strength(planes[..., 1:]), SENT_REACH)
        limit = SENT_SHARE * blurred(_strength(expected), SENT_REACH)
        missing = np.clip(1 - sent / np.maximum(limit, np.float32(1e-3)), 0, 1)
        planes[..., 1:] += missing[..., None] * expected
        return from_planes(planes, 1.0)

    def texture(self, added: Single) -> Picture:
        """Mean and what modes add (size * size * 3,), within the colours nearby."""
        drawn = np.empty(self._mean.shape, np.uint8)
        _limited(self._mean, added.reshape(-1, 3), self._low, self._high, drawn)
        size = round(len(drawn) ** 0.5)
        return drawn.reshape(size, size, 3)


def _parts(size: int) -> Integers:
    """(size, size) the part at each texel of the atlas, an index of `PARTS`; -1: none."""
    head, part_of = head_with_surround(), np.full((size, size), -1)
    atlas = atlas_of(head, size)
    part_of[atlas.rows, atlas.columns] = head.parts[atlas.corners[:, 0]]
    return part_of


def _ratio(planes: Single) -> Single:
    """Colour differences per unit of luma."""
    return np.asarray(planes[..., 1:] / np.maximum(planes[..., :1], MIN_LUMA), np.float32)


def _strength(differences: Single) -> Single:
    """(h, w) the lengths of two colour differences (h, w, 2)."""
    blue, red = differences[..., 0], differences[..., 1]
    return np.asarray(np.sqrt(blue * blue + red * red), np.float32)


@jit
def _limited(mean: Single, added: Single, low: Single, high: Single, drawn: Picture) -> None:
    """Write mean + added (k, 3), BGR, its colour differences within low and high (k, 2) x luma."""
    half, slack, zero = np.float32(0.5), np.float32(SLACK_GREY), np.float32(0)
    for k in range(len(mean)):
        blue, green, red = (
            mean[k, 0] + added[k, 0],
            mean[k, 1] + added[k, 1],
            mean[k, 2] + added[k, 2],
        )
        luma = BLUE * blue + GREEN * green + RED * red
        bright = max(luma, zero)
        from_blue = min(max(blue - luma, low[k, 0] * bright - slack), high[k, 0] * bright + slack)
        from_red = min(max(red - luma, low[k, 1] * bright - slack), high[k, 1] * bright + slack)
        blue, red = luma + from_blue, luma + from_red
        green = (luma - BLUE * blue - RED * red) / GREEN
        # Adding 0.5 and truncating rounds.
        drawn[k, 0] = np.uint8(min(max(blue + half, zero), np.float32(255)))
        drawn[k, 1] = np.uint8(min(max(green + half, zero), np.float32(255)))
        drawn[k, 2] = np.uint8(min(max(red + half, zero), np.float32(255)))
