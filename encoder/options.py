"""What an encoder run is asked for, and what it reports."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from encoder.tracking.trackers import FollowOptions
from protocol.link.interface import Reachability


@dataclass(frozen=True, slots=True)
class EncodeOptions:
    """What to encode and where to send it.

    source: video file, image pattern (frame_%04d.png), camera index or URL.
    output: call file, or an open stream for its bytes.
    connect, listen: Zenoh endpoints (tcp/HOST:PORT); call: name of the call there.
    lossless: over the network no packet is dropped, however slow: for measurements, not live calls.
    tracking: how the thesis profile tracks the face.
    profile: "thesis" or "default".
    bitrate: bits per second that frame packets take (default profile).
    startup_bitrate: bits per second of all packets together while the model is sent in layers
        (default profile), above `bitrate`; None: the model is sent whole, at once.
    fps: code about this many frames a second (default profile), see `gop_for_fps`; None: all.
    live: one pass, as if the source were a camera (default profile).
    pace: send at the source's own rate, as a camera would, instead of as fast as possible.
    wait_for_peer_s: wait this long for a decoder before the first frame, beginning with the link;
        0: wait only until the link is made.
    look_for_face_s: warn if there is no face after this many seconds of video.
    model_bytes: approximate size of the model packet; None: the profile's usual one.
    """

    source: str
    output: Path | BinaryIO | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    call: str = "call"
    lossless: bool = False
    profile: str = "default"
    bitrate: float = 800.0
    startup_bitrate: float | None = None
    fps: float | None = None
    live: bool = False
    follow: FollowOptions = field(default_factory=FollowOptions)
    pace: bool = False
    max_frames: int | None = None
    wait_for_peer_s: float = 0.0
    look_for_face_s: float = 10.0
    model_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class EncodeReport:
    """What was sent.

    frames: of the call.  fps, width, height: of the source.
    coded_fps: frames a second that were coded.
    model_bytes, frame_bytes: payload of the packets.
    stage_ms: mean time per frame of each stage, ms.
    capture_ns: `time.monotonic_ns` at which each source frame was read.
    reach: whom the last packet could reach.
    """

    frames: int
    fps: float
    coded_fps: float
    width: int
    height: int
    model_bytes: int
    frame_bytes: int
    packets: int
    lost_frames: int
    stage_ms: dict[str, float]
    warnings: tuple[str, ...]
    capture_ns: tuple[int, ...]
    reach: Reachability
