"""The still in two: the person, who moves with the head, and what is behind, which stands still."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.appearance import decode_image
from protocol.pictures.foreground_mask import Mask, parse_background

Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# How soft the silhouette's edge is, in places of its map, and how much of what is then left of it
# makes a place the person's, from not at all to wholly: hair beyond the edge moves with the head.
FEATHER_SIGMA = 1.5
ALPHA_RANGE = 0.02, 0.3
# What is known of a quarter of a place of the pyramid is known of all of it.
SATURATION = 4.0


@dataclass(frozen=True, slots=True)
class BackgroundLayers:
    """What stands behind the caller.

    picture: (h, w, 3) uint8 BGR, or (h, w, 4) with its opacity.
    behind: (h, w, 3) uint8 BGR, what shows through; None: nothing does.
    """

    moving: Picture
    static: Picture | None = None


def load_background(background: bytes) -> BackgroundLayers:
    """The still in a model packet's background; black if it is empty, see `Playout.model`.

    Raises `ProtocolError` if it is damaged or too large.
    """
    if not background:
        return BackgroundLayers(np.zeros((2, 2, 3), np.uint8))
    silhouette, data = parse_background(background)
    picture = decode_image("background", data)
    if silhouette is None:
        return BackgroundLayers(picture)
    share = _feathered(silhouette, picture.shape[1], picture.shape[0])
    low, high = ALPHA_RANGE
    opacity = np.clip((share - low) / (high - low), 0, 1)
    behind = pull_push_fill(picture, share <= low)
    return BackgroundLayers(np.dstack([picture, np.rint(255 * opacity).astype(np.uint8)]), behind)


def pull_push_fill(picture: Picture, known: NDArray[np.bool_]) -> Picture:
    """The picture (h, w, 3) with what is not known (h, w) continued from around it, smoothly.

    Each level of a pyramid is the mean of what is known of the finer one (push and pull, Gortler et
    al. 1996).
    """
    colours = _pull_push(picture.astype(np.float32), known.astype(np.float32))
    return np.asarray(np.rint(colours), np.uint8)


def _pull_push(colours: Single, weight: Single) -> Single:
    """Colours (h, w, 3), where they are not known from around; weight (h, w): how far they are."""
    if max(weight.shape) <= 2:
        return colours
    known = cv2.pyrDown(weight)
    means = cv2.pyrDown(colours * weight[..., None]) / np.maximum(known, 1e-6)[..., None]
    around = _pull_push(np.asarray(means), np.minimum(SATURATION * known, 1))
    size = weight.shape[1], weight.shape[0]
    wide = cv2.pyrUp(around, dstsize=_doubled(around))[: size[1], : size[0]]
    share = weight[..., None]
    return np.asarray(share * colours + (1 - share) * wide, np.float32)


def _doubled(image: Single) -> tuple[int, int]:
    return 2 * image.shape[1], 2 * image.shape[0]


def _feathered(silhouette: Mask, width: int, height: int) -> Single:
    """(height, width) 1 well within the silhouette, 0 well beyond it."""
    soft = cv2.GaussianBlur(silhouette.astype(np.float32), (0, 0), FEATHER_SIGMA)
    return np.asarray(cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR))
