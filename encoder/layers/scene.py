"""The picture of the scene: what stands behind the person, from all frames of a sample."""

import numpy as np
from numpy.typing import NDArray

from encoder.layers.layer_samples import LayerSamples
from encoder.layers.robust_mean import robust_mean
from shared_model.appearance import pull_push_fill

Single = NDArray[np.float32]

# The matte up to which a pixel shows the scene; its weight falls to 0 there.
CLEAR_MATTE = 0.25
# A pixel is known if the frames that show it weigh as much as so many.
MIN_FRAMES = 0.75


def scene_picture(samples: LayerSamples) -> Single:
    """(h, w, 3) BGR the scene; what the person always hides is filled in smoothly."""
    mattes = samples.mattes_at(samples.pictures.shape[1:3])
    weights = np.maximum(1 - mattes / CLEAR_MATTE, 0)
    mean = robust_mean(samples.pictures, weights)
    return pull_push_fill(mean, weights.sum(0) > MIN_FRAMES)
