"""Principal component analysis of luma texture samples."""

import numpy as np

from encoder.appearance.template import Template
from encoder.appearance.texture_samples import TextureSamples
from shared_model.arrays import Single


def luma_modes(samples: TextureSamples, mean: Single, count: int) -> Single:
    """The leading `count` principal components (count, k) of luma samples about `mean` (k, 1).

    The components have unit length in the metric of the samples' texel weights.
    """
    if not count:
        return np.zeros((0, len(mean)), np.float32)
    residual = (samples.colours - mean)[..., 0] * samples.visible
    root = np.sqrt(np.maximum(samples.weight, 1e-6))
    rows = np.asarray(residual * root, np.float32)
    # Frames are fewer than texels: the Gram matrix of the frames is smaller than an SVD's input.
    _, vectors = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    modes = vectors[:, : -count - 1 : -1].T.astype(np.float32) @ rows
    lengths = np.maximum(np.linalg.norm(modes, axis=1, keepdims=True), 1e-6)
    return np.asarray(modes / lengths / root, np.float32)


def make_template(samples: TextureSamples, mean: Single, modes: Single) -> Template:
    """The template of a mean (k, 1) and modes (m, k), luma, with the weights of the samples."""
    return Template(mean[:, 0], modes, samples.weight)
