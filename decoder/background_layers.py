"""The background picture in two layers: the person, who moves, and the scene behind."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.appearance import decode_image
from protocol.pictures.foreground_mask import Mask, parse_background

Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# Feathering of the mask, in its cells, and the range of the feathered mask over which alpha rises
# from 0 to 1.  It starts low: hair outside the mask moves with the head.
FEATHER_SIGMA = 1.5
ALPHA_RANGE = 0.02, 0.3
# A pixel of a pyramid level a quarter of which is known counts as known.
SATURATION = 4.0


@dataclass(frozen=True, slots=True)
class BackgroundLayers:
    """The layers behind the head.

    moving: (h, w, 3) uint8 BGR, or (h, w, 4) with alpha: moves with the head.
    static: (h, w, 3) uint8 BGR: stands still behind it; None if `moving` is opaque.
    """

    moving: Picture
    static: Picture | None = None


def load_background(background: bytes) -> BackgroundLayers:
    """The layers of a model packet's background; black if it is empty.

    Raises `ProtocolError` if the background is damaged or too large.
    """
    if not background:
        return BackgroundLayers(np.zeros((2, 2, 3), np.uint8))
    mask, data = parse_background(background)
    picture = decode_image("background", data)
    if mask is None:
        return BackgroundLayers(picture)
    feathered = _feathered(mask, picture.shape[1], picture.shape[0])
    low, high = ALPHA_RANGE
    alpha = np.rint(255 * np.clip((feathered - low) / (high - low), 0, 1)).astype(np.uint8)
    static = pull_push_fill(picture, feathered <= low)
    return BackgroundLayers(np.dstack([picture, alpha]), static)


def pull_push_fill(picture: Picture, known: NDArray[np.bool_]) -> Picture:
    """The picture (h, w, 3), its unknown pixels filled smoothly from around.

    known: (h, w).  Pull-push over a Gaussian pyramid (Gortler et al. 1996).
    """
    colours = _pull_push(picture.astype(np.float32), known.astype(np.float32))
    return np.asarray(np.rint(colours), np.uint8)


def _pull_push(colours: Single, weight: Single) -> Single:
    """Colours (h, w, 3) filled where their weight (h, w), 0..1, is below 1."""
    if max(weight.shape) <= 2:
        return colours
    known = cv2.pyrDown(weight)
    means = cv2.pyrDown(colours * weight[..., None]) / np.maximum(known, 1e-6)[..., None]
    coarse = _pull_push(np.asarray(means), np.minimum(SATURATION * known, 1))
    height, width = weight.shape
    filled = cv2.pyrUp(coarse, dstsize=_doubled(coarse))[:height, :width]
    own = weight[..., None]
    return np.asarray(own * colours + (1 - own) * filled, np.float32)


def _doubled(image: Single) -> tuple[int, int]:
    return 2 * image.shape[1], 2 * image.shape[0]


def _feathered(mask: Mask, width: int, height: int) -> Single:
    """(height, width) the mask with a soft edge, 0..1."""
    blurred = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), FEATHER_SIGMA)
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR))
