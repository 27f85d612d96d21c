"""The sample aspect ratio of a Matroska file, which PyAV cannot hand to FFmpeg's muxer.

The muxer is asked for a display rotation, whose element (14 bytes) then makes room for the width
and height at which pictures are shown (RFC 9559, 5.1.4.1.28).
"""

from fractions import Fraction
from pathlib import Path

from av.video.stream import VideoStream

from protocol.sample_aspect import shown_size

# The elements, by their identifiers: Projection with the rotation's size and head, and ours.
_PROJECTION = bytes.fromhex("76708b767588")
_PROJECTION_BYTES = 14
_DISPLAY_WIDTH, _DISPLAY_HEIGHT, _VOID = b"\x54\xb0\x82", b"\x54\xba\x82", b"\xec\x82"
# DisplayUnit: unknown, as the muxer writes it, and pixels.
_UNKNOWN_UNIT, _PIXEL_UNIT = b"\x54\xb2\x81\x04", b"\x54\xb2\x81\x00"
# Headers end before this.
_HEAD_BYTES = 65536
MAX_SIDE_PX = 0xFFFF
# Check sums would have to be made again.
CONTAINER_OPTIONS = {"write_crc": "0"}


def make_room(stream: VideoStream) -> None:
    """Before the header is written."""
    stream.set_display_rotation(90)


def state_aspect(path: Path, width: int, height: int, aspect: Fraction) -> None:
    """State it in a finished file whose stream had `make_room`.  width, height: of the pictures."""
    shown = shown_size(width, height, aspect)
    sides = [min(side, MAX_SIDE_PX).to_bytes(2, "big") for side in shown]
    elements = _DISPLAY_WIDTH + sides[0] + _DISPLAY_HEIGHT + sides[1] + _VOID + bytes(2)
    assert len(elements) == _PROJECTION_BYTES
    with path.open("r+b") as file:
        head = file.read(_HEAD_BYTES)
        for before, after in ((_PROJECTION, elements), (_UNKNOWN_UNIT, _PIXEL_UNIT)):
            file.seek(head.index(before))
            file.write(after)
