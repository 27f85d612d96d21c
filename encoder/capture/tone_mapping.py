"""Pictures of high dynamic range (BT.2100: PQ and HLG) as pictures of standard range.

Light is brought to the primaries of BT.709, and what is brighter than a white page rolls off
towards the brightest value instead of being cut.
"""

import numpy as np
from numpy.typing import NDArray

from runtime.jit import jit
from shared_model.arrays import Array, Picture, Single

Deep = NDArray[np.uint16]

# Luminance of a white page and of the brightest highlight, cd/m^2 (BT.2408).
WHITE_CD, PEAK_CD = 203.0, 1000.0
# Gamma of a display of standard range (BT.1886), and the system gamma of HLG at the peak.
DISPLAY_GAMMA, SYSTEM_GAMMA = 2.4, 1.2
# Light up to this share of a white page stays; what is brighter rolls off towards 1.
KNEE = 0.6
# BT.2020 to BT.709 in linear light (BT.2087), R, G, B.
BT709_FROM_BT2020 = np.array(
    [
        [1.660491, -0.587641, -0.072850],
        [-0.124550, 1.132900, -0.008349],
        [-0.018151, -0.100579, 1.118730],
    ],
    np.float32,
)
LEVELS = 4096


class ToneMapper:
    """Turns pictures of one transfer characteristic, "PQ" or "HLG", into 8 bits."""

    def __init__(self, transfer: str) -> None:
        signal = np.linspace(0, 1, LEVELS)
        light_cd = _pq_light_cd(signal) if transfer == "PQ" else PEAK_CD * _hlg_scene_light(signal)
        self._light = (light_cd / WHITE_CD).astype(np.float32)
        self._is_scene_light = transfer != "PQ"
        shown = np.linspace(0, 1, LEVELS) ** (1 / DISPLAY_GAMMA)
        self._codes = np.rint(255 * shown).astype(np.uint8)

    def apply(self, picture: Deep) -> Picture:
        """(h, w, 3) uint8 BGR of a picture (h, w, 3) uint16 RGB, BT.2020 primaries."""
        mapped = np.empty(picture.shape, np.uint8)
        exponent = np.float32(SYSTEM_GAMMA - 1 if self._is_scene_light else 0.0)
        tables = self._light, self._codes, BT709_FROM_BT2020
        _map_pixels(picture.reshape(-1, 3), mapped.reshape(-1, 3), *tables, exponent)
        return mapped


def _pq_light_cd(signal: Array) -> Array:
    """Luminance, cd/m^2, of PQ values 0..1 (SMPTE ST 2084)."""
    m1, m2 = 2610 / 16384, 2523 / 32
    c1, c2, c3 = 3424 / 4096, 2413 / 128, 2392 / 128
    root = signal ** (1 / m2)
    return 10_000 * (np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1)


def _hlg_scene_light(signal: Array) -> Array:
    """Light of the scene, 0..1, of HLG values 0..1 (ARIB STD-B67)."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12)


@jit
def _map_pixels(
    pixels: Deep,
    mapped: Picture,
    light: Single,
    codes: Picture,
    matrix: Single,
    exponent: np.float32,
) -> None:
    """pixels: (n, 3) RGB.  mapped: (n, 3) BGR, written.

    light: of each level, 1 is a white page.  codes: of each level of light, 0..1.
    matrix: (3, 3), see `BT709_FROM_BT2020`.  exponent: of the scene's luminance, 0..1; light times
    that power of it is the light of the display.
    """
    last = len(codes) - 1
    for n in range(len(pixels)):
        red = light[pixels[n, 0] >> 4]
        green = light[pixels[n, 1] >> 4]
        blue = light[pixels[n, 2] >> 4]
        if exponent > 0:
            luminance = (0.2627 * red + 0.678 * green + 0.0593 * blue) * (WHITE_CD / PEAK_CD)
            gain = max(luminance, 1e-6) ** exponent
            red, green, blue = red * gain, green * gain, blue * gain
        brightest, scale = max(red, green, blue), 1.0
        if brightest > KNEE:
            rest = 1 - KNEE
            scale = (1 - rest / (1 + (brightest - KNEE) / rest)) / brightest
        for c in range(3):
            value = matrix[c, 0] * red + matrix[c, 1] * green + matrix[c, 2] * blue
            level = min(max(value * scale, 0.0), 1.0)
            mapped[n, 2 - c] = codes[int(level * last + 0.5)]
