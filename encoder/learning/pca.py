"""Principal components of texture samples."""

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.template import Template
from encoder.appearance.texture_samples import Stack

Single = NDArray[np.float32]


def luma_modes(stack: Stack, mean: Single, count: int) -> Single:
    """(count, k) leading modes of a stack of luma about `mean` (k, 1), for tracking."""
    if not count:
        return np.zeros((0, len(mean)), np.float32)
    residual = (stack.colours - mean)[..., 0] * stack.seen
    root = np.sqrt(np.maximum(stack.weight, 1e-6))
    rows = np.asarray(residual * root, np.float32)
    # Frames are few and texels many: of the frames' inner products rather than by an SVD.
    _, vectors = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    modes = vectors[:, : -count - 1 : -1].T.astype(np.float32) @ rows
    lengths = np.maximum(np.linalg.norm(modes, axis=1, keepdims=True), 1e-6)
    return np.asarray(modes / lengths / root, np.float32)


def template_of(stack: Stack, mean: Single, modes: Single) -> Template:
    """The tracking template of a mean (k, 1) and modes (m, k), luma."""
    return Template(mean[:, 0], modes, stack.weight)
