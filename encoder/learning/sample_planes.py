"""Texture samples as an appearance encoder compares them: weighted planes, less a mean."""

import numpy as np

from protocol.pictures.picture_codec import MODE_CHROMA_WEIGHT, to_luma
from runtime.jit import jit
from shared_model.arrays import Mask, Single


@jit
def without_mean(frames: Single, mean: Single, visible: Mask) -> Single:
    """Frames (t, k, 3) less a mean (k, 3) where a texel is visible (t, k)."""
    left = np.empty_like(frames)
    for frame in range(len(frames)):
        for texel in range(len(mean)):
            for channel in range(3):
                value = frames[frame, texel, channel]
                if visible[frame, texel]:
                    value -= mean[texel, channel]
                left[frame, texel, channel] = value
    return left


def weighted_planes(colours: Single, visible: Mask, root: Single) -> Single:
    """(t, k, 3) the planes of colours (t, k, 3), see `to_planes`, times `root` (k,) where a texel
    is visible (t, k), else 0."""
    return _weighted_planes(colours, to_luma(colours), visible, root, MODE_CHROMA_WEIGHT)


@jit
def _weighted_planes(
    colours: Single, luma: Single, visible: Mask, root: Single, chroma_weight: float
) -> Single:
    """See `weighted_planes`.  luma: (t, k) of the colours."""
    planes, chroma = np.zeros_like(colours), np.float32(chroma_weight)
    for frame in range(len(colours)):
        for texel in range(len(root)):
            if visible[frame, texel]:
                y = luma[frame, texel]
                planes[frame, texel, 0] = y * root[texel]
                planes[frame, texel, 1] = chroma * (colours[frame, texel, 0] - y) * root[texel]
                planes[frame, texel, 2] = chroma * (colours[frame, texel, 2] - y) * root[texel]
    return planes
