"""A videophone that sends a face as muscles, not pixels: its Python interface.

Record a call, and see what it weighs:

>>> import risorius
>>> report = risorius.encode("me.mp4", "call.rzo", max_frames=8)
>>> report.frames, report.width, report.height
(8, 176, 144)
>>> summary = risorius.info("call.rzo")
>>> summary.frames, summary.complete
(8, True)

Draw it, picture by picture:

>>> with risorius.open_call("call.rzo") as call:
...     for time_s, picture in call:
...         print(f"{time_s:.3f}", picture.shape, picture.dtype)
...         break
0.000 (144, 176, 3) uint8

Follow the face without a call:

>>> track = risorius.track("me.mp4", max_frames=8)
>>> track.pose.shape, track.eau.shape
((8, 6), (8, 14))
>>> sorted(track.action_units)[:3]
['AU1', 'AU10', 'AU12']
>>> track.write_csv("me.csv")

What a user can mend raises `UserError`.  Libraries are loaded by the function that needs them.
While a source is encoded, linear algebra has one thread for each call of it.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from shared_model.errors import UserError

if TYPE_CHECKING:
    from encoder.report import EncodeReport
    from protocol.summary import CallSummary
    from risorius.call import Call
    from risorius.face_track import FaceTrack

__all__ = ["UserError", "__version__", "encode", "info", "open_call", "track"]

Progress = Callable[[int, int | None], None]


def __getattr__(name: str) -> str:
    """`__version__`: looked up where it is asked for."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import version

    return version("risorius")


def encode(
    source: str | Path,
    output: str | Path | BinaryIO,
    *,
    profile: str | None = None,
    bitrate: float = 800.0,
    fps: float | None = None,
    live: bool = False,
    model_bytes: int | None = None,
    voice: str | None = None,
    max_frames: int | None = None,
    progress: Progress | None = None,
) -> "EncodeReport":
    """Encode a video into a call file, or into an open stream of its bytes.

    source: video file, image pattern (frame_%04d.png), camera index or URL.
    profile: "default" or "thesis"; None: default where the landmark networks are installed.
    bitrate: bits a second of frame packets.  fps: code about so many frames a second; None: all.
    live: one pass, as for a camera.  These three are of the default profile.
    model_bytes: approximate size of the model packet; None: as usual, for the bitrate.
    voice: "off", "700C", "1200" or "opus"; None: 1200 where the source has sound and the codec is
        installed.
    max_frames: stop after so many frames.
    progress: called with the number of frames so far and of all, None if that is not known.
    Raises `UserError` if the source cannot be read or shows no face, or if an option has no effect,
    `ValueError` for a value out of its range.
    """
    from risorius.encoding import encode_checked

    rates: dict[str, object] = {"bitrate": bitrate, "fps": fps, "live": live, "voice": voice}
    sizes: dict[str, object] = {"model_bytes": model_bytes, "max_frames": max_frames}
    return encode_checked(source, output, {"profile": profile, **rates, **sizes}, progress)


def open_call(
    source: str | Path | BinaryIO | None = None,
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    call: str | None = None,
    face: str | Path | None = None,
    invite: str | None = None,
    insecure: bool = False,
) -> "Call":
    """Open a call to iterate its pictures: (time in seconds, (height, width, 3) uint8 BGR) each.

    source: call file, or an open stream of one; None: over the network.
    listen, connect: Zenoh endpoints such as tcp/0.0.0.0:7447; call: the call's name there; None:
        that of the invitation, else "call".
    face: call file whose person is drawn instead.
    invite: the line that the other end, or `risorius invite`, has printed: its key, and where and
        under which name the call is.  insecure: go without beyond this host.
    Use it as a context manager, or close it.  Raises `UserError` if the call cannot be read or
    drawn, or if arguments contradict each other.
    """
    from risorius.call import open_call

    target = None if face is None else Path(face)
    return open_call(source, tuple(listen), tuple(connect), call, target, invite, insecure)


def info(path: str | Path) -> "CallSummary":
    """What is in a call file: frames, duration, bytes and rates of its parts.

    Raises `UserError` if it is no call or cannot be read.
    """
    from risorius.call_info import call_info

    return call_info(Path(path))


def track(
    source: str | Path,
    *,
    max_frames: int | None = None,
    progress: Progress | None = None,
    aam: str | Path | None = None,
    aam_feedback: bool = False,
) -> "FaceTrack":
    """Track a face: per frame its pose in degrees and mm, EAUs, action units, emotions, confidence.

    source: as for `encode`.  aam: a model of `risorius train` that finds landmarks instead of the
    network.  aam_feedback: it also measures every frame's actuators.
    Raises `UserError` if it cannot be read or shows no face.
    """
    from risorius.face_track import track

    return track(str(source), max_frames, progress, aam=aam, aam_feedback=aam_feedback)
