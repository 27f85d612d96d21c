"""What an encoder run is asked for."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from encoder.residual.draw_call import DrawCall
from encoder.thesis.tracking_options import TrackingOptions
from protocol.link.interface import LinkOptions


@dataclass(frozen=True, slots=True)
class EncodeOptions:
    """What to encode and where to send it.

    source: video file, image pattern (frame_%04d.png), camera index or URL.
    output: call file, or an open stream for its bytes.
    monitor: an open stream that gets the call as well, to look at what is sent; None: none.
    link: over which network it is sent, where there is no output.
    tracking: how the thesis profile tracks the face.
    profile: "thesis" or "default".
    texture_modes: of a recorded call in the thesis profile, at most so many appearance modes of the
        person; 0: one texture.
    bitrate: bits per second that frame packets take (default profile).
    startup_bitrate: bits per second of all packets together while the model is sent in layers
        (default profile), above `bitrate`; None: what a thin link carries, else the model is sent
        whole, at once.
    fps: code about this many frames a second (default profile), see `gop_for_fps`; None: all.
    low_delay: packets of half as many frames (default profile).
    two_way: one end of a conversation: packets of a live call are coded as soon as they are full.
    live: one pass, as if the source were a camera (default profile).
    delay_s: a live call codes each frame this long after it has been seen, with what was learned
        from those after it.
    pace: send at the source's own rate, as a camera would, instead of as fast as possible.
    wait_for_peer_s: wait this long for a decoder before the first frame; 0: do not wait.
    look_for_face_s: warn if there is no face after this many seconds of video.
    model_bytes: approximate size of the model packet; None: as usual, see `budget_for`.
    draw: draws the call that is encoded, to code what its pictures lack (default profile, with bits
        to spare); None: that is not coded.
    voice: codec of the voice, one of `VOICES`; None: 1200 where the source has sound and the codec
        is installed.
    """

    source: str
    output: Path | BinaryIO | None = None
    monitor: BinaryIO | None = None
    link: LinkOptions | None = None
    profile: str = "default"
    texture_modes: int = 0
    bitrate: float = 800.0
    startup_bitrate: float | None = None
    fps: float | None = None
    low_delay: bool = False
    two_way: bool = False
    live: bool = False
    delay_s: float = 0.0
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    pace: bool = False
    max_frames: int | None = None
    wait_for_peer_s: float = 0.0
    look_for_face_s: float = 10.0
    model_bytes: int | None = None
    voice: str | None = "off"
    draw: DrawCall | None = None
