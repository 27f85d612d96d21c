"""Who is before the background: the outline of a person in the still, a map of `SIDE` x `SIDE`.

A background with a silhouette is a letter, `C`, the length of the silhouette (varint), the
silhouette, then the still.  Each place of the map is coded by what the six around it are that came
before it; those beyond the picture's edge are as the edge is not: nothing.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveBits
from protocol.entropy.range_coder import BitCoder, RangeDecoder, RangeEncoder
from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError

Mask = NDArray[np.bool_]

TAG = b"C"
# Places a side, whatever the picture's shape; and no silhouette takes more bytes.
MASK_SIDE = 96
MAX_MASK_BYTES = 2048
# Rows up and columns left of a place, of those that tell what it is.
_CONTEXT_OFFSETS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, 2), (2, 0))
_PAD = 2


def serialise_background(mask: Mask | None, picture: bytes) -> bytes:
    """A still as it is sent, with the map (SIDE, SIDE) of who is before what it shows, if known."""
    if mask is None:
        return picture
    coder = RangeEncoder()
    _code(coder, mask)
    data = coder.finish()
    return TAG + encode_varint(len(data)) + data + picture


def parse_background(data: bytes) -> tuple[Mask | None, bytes]:
    """The silhouette, if there is one, and the still of a model packet's background.

    Raises `ProtocolError` if the silhouette is damaged; the still is not looked into.
    """
    if data[:1] != TAG:
        return None, data
    try:
        length, size = decode_varint(data[1:])
    except ValueError as error:
        raise ProtocolError(f"background: silhouette: {error}") from error
    start = 1 + size
    if length > min(MAX_MASK_BYTES, len(data) - start):
        raise ProtocolError(f"background: silhouette of {length} bytes, limit {MAX_MASK_BYTES}")
    coder = RangeDecoder(data[start : start + length])
    silhouette = _code(coder, np.zeros((MASK_SIDE, MASK_SIDE), np.bool_))
    if coder.unread_bytes:
        raise ProtocolError(f"background: silhouette: {coder.unread_bytes} bytes too many")
    return silhouette, data[start + length :]


def _code(coder: BitCoder, silhouette: Mask) -> Mask:
    bits = AdaptiveBits(1 << len(_CONTEXT_OFFSETS))
    known = [[0] * (MASK_SIDE + 2 * _PAD) for _ in range(MASK_SIDE + _PAD)]
    for i, row in enumerate(silhouette.tolist(), _PAD):
        for j, shown in enumerate(row, _PAD):
            context = 0
            for up, left in _CONTEXT_OFFSETS:
                context = context << 1 | known[i - up][j - left]
            known[i][j] = bits.code(coder, context, int(shown))
    return np.array(known, np.bool_)[_PAD:, _PAD:-_PAD]
