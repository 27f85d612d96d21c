"""The light on the layers of a frame, and a sample of frames as if all had the light of the newest.

Gain and offset come from means and standard deviations, not from a regression: where two pictures
differ by motion, too, a regression finds less contrast than there is.
"""

from dataclasses import replace

import numpy as np

from encoder.capture.colour import luma_f32
from encoder.layers.layer_samples import COARSE_SIDE, LayerSamples, scaled_shape, shrunk
from encoder.layers.scene import CLEAR_MATTE
from runtime.cauchy_weight import cauchy_weight
from shared_model.arrays import Array, Picture, Single
from shared_model.layers.light import PIVOT_GREY, SAME_LIGHT, UNIT_GAIN, UNIT_GREY, Light, light_of

# Passes in which residuals are weighted.
PASSES = 4
# The least and the largest gain.
GAIN_LIMITS = (0.05, 20.0)
# The light has changed if that leaves at most this share of the mean absolute residual, of which a
# pixel counts at most so many grey levels.
MAX_LEFT, MAX_GREY = 0.6, 48.0
# Mean change, grey levels, up to which it is none, and from which on it is followed in full: in
# between motion may look like it, and the scene would flicker.
SMALL_CHANGE_GREY = 4.0, 8.0
# Standard deviation of a picture without contrast, grey levels.
NO_CONTRAST_GREY = 0.5
# Frames that need a larger gain are left out of a sample if so many others are left.
MAX_SAMPLE_GAIN, MIN_SAMPLES = 2.0, 8


def fit_light(drawn: Single, luma: Single, weight: Single) -> Array:
    """(2,) coefficients of the light that makes a picture `drawn` like `luma`; 0 if none does.

    drawn, luma, weight: (h, w).
    """
    found, trust = np.zeros(2), weight
    for _ in range(PASSES):
        found = _by_moments(drawn, luma, trust)
        residual = luma - lit(drawn, light_of(found))
        trust = cauchy_weight(residual, weight=weight)
    relit = lit(drawn, light_of(found))
    after, before = (
        float((np.minimum(np.abs(luma - picture), MAX_GREY) * weight).sum())
        for picture in (relit, drawn)
    )
    if after >= MAX_LEFT * before:
        return np.zeros(2)
    low, high = SMALL_CHANGE_GREY
    change = float(np.abs(relit - drawn).mean())
    return found * min(max((change - low) / (high - low), 0.0), 1.0)


def lit(picture: Single, light: Light) -> Single:
    """Grey levels of a picture in a light."""
    return np.asarray(light.gain * (picture - PIVOT_GREY) + PIVOT_GREY + light.offset, np.float32)


def lit_picture(picture: Picture, light: Light) -> Picture:
    """A picture (h, w, 3) uint8 BGR in a light."""
    changed = np.clip(lit(picture.astype(np.float32), light), 0, 255)
    return np.asarray(np.rint(changed), np.uint8)


def unlit(picture: Single, light: Light) -> Single:
    """What looks like `picture` in a light whose gain is not 0."""
    return np.asarray((picture - PIVOT_GREY - light.offset) / light.gain + PIVOT_GREY, np.float32)


def in_newest_light(samples: LayerSamples) -> LayerSamples:
    """A sample whose pictures have the light of the newest, where that explains the difference.

    Where enough are left, frames that were too dark for it to tell much are left out.
    """
    shape = scaled_shape(samples.size, COARSE_SIDE)
    lumas = [luma_f32(shrunk(picture, shape)) for picture in samples.pictures]
    mattes = samples.mattes_at(shape)
    behind = [(np.maximum(m, mattes[-1]) < CLEAR_MATTE).astype(np.float32) for m in mattes]
    lights = [
        light_of(fit_light(luma, lumas[-1], weight))
        for luma, weight in zip(lumas, behind, strict=True)
    ]
    pictures = [
        picture if light == SAME_LIGHT else lit_picture(picture, light)
        for picture, light in zip(samples.pictures, lights, strict=True)
    ]
    bright = [number for number, light in enumerate(lights) if light.gain <= MAX_SAMPLE_GAIN]
    relit = replace(samples, pictures=np.array(pictures))
    if len(bright) < MIN_SAMPLES:
        return relit
    return relit.chosen(sorted({samples.canonical, *bright}))


def _by_moments(drawn: Single, luma: Single, weight: Single) -> Array:
    """(2,) coefficients of the light that gives `drawn` mean and contrast of `luma`."""
    total = max(float(weight.sum()), 1e-6)
    means = [float((image * weight).sum()) / total for image in (drawn, luma)]
    spread = [
        np.sqrt(float(((image - mean) ** 2 * weight).sum()) / total + NO_CONTRAST_GREY**2)
        for image, mean in zip((drawn, luma), means, strict=True)
    ]
    gain = float(np.clip(spread[1] / spread[0], *GAIN_LIMITS))
    offset = means[1] - PIVOT_GREY - gain * (means[0] - PIVOT_GREY)
    return np.array([(gain - 1) / UNIT_GAIN, offset / UNIT_GREY])
