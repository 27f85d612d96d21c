"""Who is before the background: the outline of a person in the still, a map of `SIDE` x `SIDE`.

A background with a silhouette is a letter, `C`, the length of the silhouette (varint), the
silhouette, then the still.  Each place of the map is coded by what the six around it are that came
before it; those beyond the picture's edge are as the edge is not: nothing.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveBits
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder
from protocol.entropy.varint import decode_varint, encode_varint
from protocol.frames.value_coding import BitCoder
from protocol.packets import ProtocolError

Map = NDArray[np.bool_]

LETTER = b"C"
# Places a side, whatever the picture's shape; and no silhouette takes more bytes.
SIDE = 96
MAX_BYTES = 2048
# Rows up and columns left of a place, of those that tell what it is.
_BEFORE = ((0, 1), (1, 1), (1, 0), (1, -1), (0, 2), (2, 0))
_PAD = 2


def serialise_background(silhouette: Map | None, still: bytes) -> bytes:
    """A still as it is sent, with the map (SIDE, SIDE) of who is before what it shows, if known."""
    if silhouette is None:
        return still
    coder = RangeEncoder()
    _code(coder, silhouette)
    data = coder.finish()
    return LETTER + encode_varint(len(data)) + data + still


def parse_background(data: bytes) -> tuple[Map | None, bytes]:
    """The silhouette, if there is one, and the still of a model packet's background.

    Raises `ProtocolError` if the silhouette is damaged; the still is not looked into.
    """
    if data[:1] != LETTER:
        return None, data
    try:
        length, size = decode_varint(data[1:])
    except ValueError as error:
        raise ProtocolError(f"background: silhouette: {error}") from error
    start = 1 + size
    if length > min(MAX_BYTES, len(data) - start):
        raise ProtocolError(f"background: silhouette of {length} bytes, limit {MAX_BYTES}")
    coder = RangeDecoder(data[start : start + length])
    silhouette = _code(coder, np.zeros((SIDE, SIDE), np.bool_))
    if coder.surplus:
        raise ProtocolError(f"background: silhouette: {coder.surplus} bytes too many")
    return silhouette, data[start + length :]


def _code(coder: BitCoder, silhouette: Map) -> Map:
    bits = AdaptiveBits(1 << len(_BEFORE))
    known = [[0] * (SIDE + 2 * _PAD) for _ in range(SIDE + _PAD)]
    for i, row in enumerate(silhouette.tolist(), _PAD):
        for j, shown in enumerate(row, _PAD):
            context = 0
            for up, left in _BEFORE:
                context = context << 1 | known[i - up][j - left]
            known[i][j] = bits.code(coder, context, int(shown))
    return np.array(known, np.bool_)[_PAD:, _PAD:-_PAD]
