"""Images within a size: WebP files of the thesis profile, wavelet pictures of the default one."""

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.picture_coding.picture_encoder import draft_still
from encoder.picture_coding.quantiser_search import finest_within
from protocol.pictures.picture_codec import MAX_STEP
from protocol.pictures.probability_model import STILL

Picture = NDArray[np.uint8]
Texels = NDArray[np.float32]
QUALITIES = (1, 95)
BACKGROUND_SIDES_PX = (640, 448, 320, 224)
# So many steps of the quantiser coarser a still takes about half the bytes.
STEPS_PER_HALVING = 8


def compress(picture: Picture, max_bytes: int) -> bytes:
    """The best WebP file of at most `max_bytes`; at the lowest quality even if that is larger."""
    low, high = QUALITIES
    best = _webp(picture, low)
    while low < high:
        middle = (low + high + 1) // 2
        data = _webp(picture, middle)
        if len(data) <= max_bytes:
            low, best = middle, data
        else:
            high = middle - 1
    return best


def compress_background(frame: Picture, max_bytes: int) -> bytes:
    """The WebP file within `max_bytes` nearest to `frame`, scaled down as far as that helps."""
    longest = max(frame.shape[:2])
    reach = min(longest, BACKGROUND_SIDES_PX[0])
    judged = _scaled(frame, reach / longest).astype(np.float32)
    best, least = b"", np.inf
    for side in (reach, *(s for s in BACKGROUND_SIDES_PX if s < reach)):
        data = compress(_scaled(frame, side / longest), max_bytes)
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        shown = cv2.resize(decoded, judged.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        error = float(((shown - judged) ** 2).mean()) + 1e6 * (len(data) > max_bytes)
        if error < least:
            best, least = data, error
    return best


def code_background(frame: Picture, max_bytes: int) -> bytes:
    """The still of at most `max_bytes` nearest to `frame`, its longer side at most 640 pixels."""
    small = _scaled(frame, BACKGROUND_SIDES_PX[0] / max(frame.shape[:2]))
    return finest_still(small.astype(np.float32), max_bytes)[0]


def finest_still(
    colours: Texels, max_bytes: int, relief: bytes = b"", kind: int = STILL
) -> tuple[bytes, Texels]:
    """The best coding of a picture (h, w, 3) within `max_bytes`, and what it decodes to.

    At the coarsest step even if that is larger.  relief, kind: see `draft_still`.
    """
    best = finest_within(
        lambda step: draft_still(colours, step, relief, kind),
        lambda draft: draft.size_bytes,
        max_bytes,
        range(MAX_STEP + 1),
        MAX_STEP // 2,
        STEPS_PER_HALVING,
    )[1]
    return best.write(), best.colours


def _scaled(frame: Picture, ratio: float) -> Picture:
    if ratio >= 1:
        return frame
    size = (max(1, round(frame.shape[1] * ratio)), max(1, round(frame.shape[0] * ratio)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _webp(picture: Picture, quality: int) -> bytes:
    done, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])
    assert done
    return data.tobytes()
