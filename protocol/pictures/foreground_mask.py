"""The foreground mask of a background picture: `MASK_SIDE` x `MASK_SIDE` cells over the picture.

A background with a mask is the tag `C`, the length of the mask's bytes (varint), these bytes, then
the picture.  The context of a cell is six neighbours that are coded before it; neighbours outside
the mask count as background (0).
"""

import numpy as np

from protocol.entropy.adaptive_models import AdaptiveBits
from protocol.entropy.range_coder import RangeDecoder, RangeEncoder
from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from shared_model.arrays import Mask

TAG = b"C"
# Cells along each side, for any shape of picture; of a fine mask, which only layers may have.
MASK_SIDE, FINE_MASK_SIDE = 96, 192
MAX_MASK_BYTES = 2048
# Rows above and columns to the left of a cell: its context, the first one the highest bit.
_CONTEXT_OFFSETS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, 2), (2, 0))
_PAD = 2


def serialise_background(mask: Mask | None, picture: bytes) -> bytes:
    """A model packet's background.  mask: (MASK_SIDE, MASK_SIDE), true on the person, or None."""
    if mask is None:
        return picture
    data = encode_mask(mask)
    return TAG + encode_varint(len(data)) + data + picture


def parse_background(data: bytes) -> tuple[Mask | None, bytes]:
    """The mask, or None, and the encoded picture of a model packet's background.

    Raises `ProtocolError` if the mask is damaged.
    """
    if data[:1] != TAG:
        return None, data
    try:
        length, size = decode_varint(data[1:])
    except ValueError as error:
        raise ProtocolError(f"background: mask: {error}") from error
    start = 1 + size
    if length > min(MAX_MASK_BYTES, len(data) - start):
        raise ProtocolError(f"background: mask of {length} bytes, limit {MAX_MASK_BYTES}")
    return decode_mask(data[start : start + length]), data[start + length :]


def encode_mask(mask: Mask) -> bytes:
    """The bytes of a mask (n, n), true on the person."""
    coder = RangeEncoder()
    _encode(coder, mask)
    return coder.finish()


def decode_mask(data: bytes, side: int = MASK_SIDE) -> Mask:
    """The mask (side, side) in `data`.  Raises `ProtocolError` if it is damaged."""
    coder = RangeDecoder(data)
    mask = _decode(coder, side)
    if coder.unread_bytes:
        raise ProtocolError(f"background: mask: {coder.unread_bytes} bytes too many")
    return mask


def _decode(coder: RangeDecoder, side: int) -> Mask:
    # Imported where used: Numba takes more than a second.
    from protocol.entropy.compiled_decoding import decode_bit_map

    return decode_bit_map(coder, side, np.array(_CONTEXT_OFFSETS)).astype(np.bool_)


def _encode(coder: RangeEncoder, mask: Mask) -> None:
    bits = AdaptiveBits(1 << len(_CONTEXT_OFFSETS))
    padded = np.pad(mask, ((_PAD, 0), (_PAD, _PAD))).tolist()
    for i in range(_PAD, len(mask) + _PAD):
        for j in range(_PAD, len(mask) + _PAD):
            context = 0
            for up, left in _CONTEXT_OFFSETS:
                context = context << 1 | padded[i - up][j - left]
            bits.code(coder, context, int(padded[i][j]))
