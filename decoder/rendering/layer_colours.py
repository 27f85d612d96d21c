"""What a frame's change and light make of the colours of the layers behind the face."""

from collections.abc import Sequence

import cv2
import numpy as np

from shared_model.arrays import Picture
from shared_model.layers.light import PIVOT_GREY, SAME_LIGHT, Light

# The grey level of a change that stands for no change.
NO_CHANGE = 128


def with_alpha(picture: Picture) -> Picture:
    """The picture (h, w, 3 or 4) uint8 with an alpha, 255 if it has none."""
    if picture.ndim != 3 or picture.shape[2] != 3:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2BGRA), np.uint8)


def changed_layers(
    layers: Sequence[Picture], change: Picture | None, light: Light
) -> list[Picture]:
    """The layers (h, w, 4) uint8 BGRA with a change and then light on their colours.

    Whole grey levels are added to a few hundred thousand texels by vector instructions: in a
    fragment shader of llvmpipe a second texture takes several times as long.
    change: (h, w, 3) uint8 BGR, stretched to each layer and added less `NO_CHANGE`; None: nothing.
    """
    changed = list(layers)
    if change is not None:
        # Nothing is added to the alpha.
        small = np.dstack([change, np.full(change.shape[:2], NO_CHANGE, np.uint8)])
        sizes = {layer.shape[1::-1] for layer in layers}
        added = {size: cv2.resize(small, size, interpolation=cv2.INTER_LINEAR) for size in sizes}
        changed = [
            np.asarray(
                cv2.addWeighted(layer, 1, added[layer.shape[1::-1]], 1, -NO_CHANGE), np.uint8
            )
            for layer in layers
        ]
    if light != SAME_LIGHT:
        table = _light_table(light)
        changed = [np.asarray(cv2.LUT(layer, table), np.uint8) for layer in changed]
    return changed


def _light_table(light: Light) -> Picture:
    """(256, 1, 4) what becomes of each grey level of blue, green, red and alpha."""
    greys = np.arange(256.0)
    lit = np.clip(light.gain * (greys - PIVOT_GREY) + PIVOT_GREY + light.offset, 0, 255)
    table = np.stack([*[np.rint(lit)] * 3, greys], -1)
    return table.astype(np.uint8)[:, None]
