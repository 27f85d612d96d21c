"""Where the picture residual is in a frame packet, and of which source frames it is.

Apart from what decodes it, so that who only counts bytes loads no compiled loops.
"""

from protocol.call_parameters import CallParameters
from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError


def covered_frames(call: CallParameters, number: int, coded: int) -> range:
    """The source frames whose residual a frame packet has: those after the packet before.

    number: of the packet within its model.  coded: number of its coded frames.
    """
    before = (number - 1) * call.frames_per_packet * call.frame_step
    first = call.start_frame + (before + 1 if number else 0)
    return range(first, first + (coded * call.frame_step if number else 1))


def join_payload(block: bytes, face: bytes) -> bytes:
    """The payload of a frame packet.  block: the bytes of the residual, empty if there is none."""
    return encode_varint(len(block)) + block + face


def split_payload(payload: bytes) -> tuple[bytes, bytes]:
    """The bytes of the residual, and of the face.  Raises `ProtocolError` if there are too few."""
    try:
        length, start = decode_varint(payload)
    except ValueError as error:
        raise ProtocolError(f"picture residual: {error}") from error
    if start + length > len(payload):
        raise ProtocolError(f"picture residual of {length} bytes in {len(payload) - start}")
    return payload[start : start + length], payload[start + length :]
