"""Images within a number of bytes: WebP in the thesis profile, wavelet pictures in the default."""

import cv2
import numpy as np

from encoder.picture_coding.picture_encoder import encode_picture
from encoder.picture_coding.quantiser_search import STEPS_PER_HALVING, finest_quantiser_within
from protocol.pictures.picture_codec import MAX_STEP_CODE
from protocol.pictures.probability_model import BACKGROUND
from shared_model.arrays import Picture, Single

# Lowest and highest WebP quality tried.
WEBP_QUALITIES = (1, 95)
# Longer sides of the background, pixels; the default profile takes the first.
BACKGROUND_SIDES_PX = (640, 448, 320, 224)
# The same of a rough one: in 500 to 700 bytes as good as a larger one, coded in half the time.
ROUGH_SIDE_PX = 320


def encode_webp_within(picture: Picture, max_bytes: int) -> bytes:
    """The best WebP file of at most `max_bytes`; the lowest quality even if that is larger.

    picture: (h, w, 3) uint8 BGR.
    """
    low, high = WEBP_QUALITIES
    best = _webp(picture, low)
    while low < high:
        middle = (low + high + 1) // 2
        data = _webp(picture, middle)
        if len(data) <= max_bytes:
            low, best = middle, data
        else:
            high = middle - 1
    return best


def encode_background_webp_within(frame: Picture, max_bytes: int) -> bytes:
    """The WebP file of at most `max_bytes` with the least squared error, over several scales.

    frame: (h, w, 3) uint8 BGR.
    """
    longest = max(frame.shape[:2])
    largest = min(longest, BACKGROUND_SIDES_PX[0])
    target = _scaled(frame, largest / longest).astype(np.float32)
    best, least = b"", np.inf
    for side in (largest, *(s for s in BACKGROUND_SIDES_PX if s < largest)):
        data = encode_webp_within(_scaled(frame, side / longest), max_bytes)
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        enlarged = cv2.resize(decoded, target.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        error = float(((enlarged - target) ** 2).mean()) + 1e6 * (len(data) > max_bytes)
        if error < least:
            best, least = data, error
    return best


def encode_background_within(
    frame: Picture, max_bytes: int, side_px: int = BACKGROUND_SIDES_PX[0]
) -> bytes:
    """The finest wavelet picture of at most `max_bytes`, scaled down to `side_px`.

    frame: (h, w, 3) uint8 BGR.
    """
    small = _scaled(frame, side_px / max(frame.shape[:2]))
    return encode_picture_within(small.astype(np.float32), max_bytes)[0]


def encode_picture_within(
    colours: Single, max_bytes: int, weight_map: bytes = b"", kind: int = BACKGROUND
) -> tuple[bytes, Single]:
    """The finest wavelet picture of at most `max_bytes`, and the picture it decodes to.

    The coarsest quantiser is taken even if its picture is larger.
    colours: (h, w, 3) BGR 0..255.  weight_map, kind: see `encode_picture`.
    """
    best = finest_quantiser_within(
        lambda step: encode_picture(colours, step, weight_map, kind),
        lambda encoded: encoded.size_bytes,
        max_bytes,
        range(MAX_STEP_CODE + 1),
        MAX_STEP_CODE // 2,
        STEPS_PER_HALVING,
    )[1]
    return best.serialise(), best.decoded


def _scaled(frame: Picture, ratio: float) -> Picture:
    """`frame` at `ratio` times its size; frames are never enlarged."""
    if ratio >= 1:
        return frame
    size = (max(1, round(frame.shape[1] * ratio)), max(1, round(frame.shape[0] * ratio)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _webp(picture: Picture, quality: int) -> bytes:
    done, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])
    assert done
    return data.tobytes()
