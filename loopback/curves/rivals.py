"""Other codecs, through PyAV's libraries or the `ffmpeg` program, each at its best.

Best effort: slow presets, with look-ahead.  Real time: fast presets, and no frame waits for later
ones.  In both, no key frame follows the first.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import av
import cv2
import numpy as np
from av.bitstream import BitStreamFilterContext
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame

from loopback.judge.ffmpeg import find_ffmpeg
from loopback.judge.programs import run_program
from shared_model.arrays import Picture
from shared_model.errors import UserError

# No key frame after the first.
ONE_GROUP = 1_000_000
# One key frame, no comment in the stream, nothing on the screen.
X265 = "keyint=-1:info=0:log-level=none"
# Codecs need even sizes, and so many pixels each way: of 44x36 x265 writes beyond its memory.
LEAST_SIDE = 64


@dataclass(frozen=True, slots=True)
class Rival:
    """A codec.

    encoder, decoder: names of FFmpeg.  best, realtime: options.
    qualities: values of its constant rate factor, the coarsest first.
    comments: type of the units of its stream that say which program has made it; None: none do.
        They are no part of the video, and are not counted.
    program: coded by the `ffmpeg` program, see `find_ffmpeg`.
    """

    name: str
    encoder: str
    decoder: str
    best: Mapping[str, str]
    realtime: Mapping[str, str]
    qualities: tuple[int, ...]
    comments: int | None = None
    program: bool = False

    @property
    def is_installed(self) -> bool:
        """Whether it can be encoded and decoded here."""
        try:
            if self.program:
                av.codec.Codec(self.decoder, "r")
                return find_ffmpeg("encoders", self.encoder) is not None
            av.codec.Codec(self.encoder, "w")
            av.codec.Codec(self.decoder, "r")
        except (ValueError, av.error.FFmpegError):
            return False
        return True


RIVALS = {
    each.name: each
    for each in (
        Rival(
            "svtav1",
            "libsvtav1",
            "libdav1d",
            {"preset": "2", "svtav1-params": "keyint=-1"},
            {"preset": "10", "svtav1-params": "keyint=-1:pred-struct=1:lookahead=0"},
            (63, 58, 53, 47, 40, 33),
        ),
        Rival(
            "x265",
            "libx265",
            "hevc",
            {"preset": "slower", "tune": "psnr", "x265-params": X265},
            {"preset": "faster", "tune": "zerolatency", "x265-params": X265},
            (51, 46, 41, 36, 31, 26),
        ),
        Rival(
            "x264",
            "libx264",
            "h264",
            {"preset": "veryslow", "tune": "psnr"},
            {"preset": "veryfast", "tune": "zerolatency"},
            (51, 46, 41, 36, 31, 26),
            comments=6,
        ),
        Rival(
            "vp9",
            "libvpx-vp9",
            "vp9",
            {
                **{"deadline": "good", "cpu-used": "0", "b:v": "0"},
                **{"lag-in-frames": "25", "auto-alt-ref": "1"},
            },
            {"deadline": "realtime", "cpu-used": "6", "b:v": "0", "lag-in-frames": "0"},
            (63, 58, 53, 47, 40, 33),
        ),
        Rival(
            "vvc",
            "libvvenc",
            "vvc",
            {"preset": "medium", "qpa": "0", "period": "1000000"},
            {"preset": "faster", "qpa": "0", "period": "1000000"},
            (58, 53, 48, 43, 38, 33),
            program=True,
        ),
    )
}


@dataclass(frozen=True, slots=True)
class RivalSetting:
    """How a rival codes a clip.

    quality: its constant rate factor.  scale: of the pictures that it codes; they are enlarged
    again.  frame_step: 2: every second frame is coded, and shown twice.
    """

    quality: int
    scale: float = 1.0
    frame_step: int = 1
    is_realtime: bool = False


def scaled_size(size: tuple[int, int], scale: float) -> tuple[int, int] | None:
    """Width and height that are coded, even; None: too small for a codec."""
    width, height = (2 * round(side * scale / 2) for side in size)
    return None if min(width, height) < LEAST_SIDE else (width, height)


def shrunk(pictures: Sequence[Picture], size: tuple[int, int]) -> list[Picture]:
    """Pictures (h, w, 3) as they are coded at a size (width, height)."""
    return [
        np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        for picture in pictures
    ]


def code(
    rival: Rival, setting: RivalSetting, pictures: Sequence[Picture], fps: Fraction
) -> "list[Packet[Any]]":
    """The packets of pictures (h, w, 3) uint8 BGR that are shrunk already, in decoding order.

    Raises `UserError`.
    """
    if rival.program:
        return _code_by_program(rival, setting, pictures, fps)
    # SVT-AV1 would greet on the screen; 1: errors alone.
    os.environ.setdefault("SVT_LOG", "1")
    height, width = pictures[0].shape[:2]
    context = cast(VideoCodecContext, VideoCodecContext.create(rival.encoder, "w"))
    context.width, context.height, context.pix_fmt = width, height, "yuv420p"
    rate = fps / setting.frame_step
    context.time_base, context.framerate = 1 / rate, rate
    context.gop_size, context.thread_count = ONE_GROUP, 1
    options = rival.realtime if setting.is_realtime else rival.best
    context.options = {**options, "crf": str(setting.quality)}
    try:
        context.open()
        _schedule_as_others()
        frames = chain(_frames(pictures, 1 / rate), [None])
        packets = [packet for frame in frames for packet in context.encode(frame)]
    except av.error.FFmpegError as error:
        raise UserError(f"{rival.name} cannot code {width}x{height}: {error}") from error
    return [kept for packet in packets for kept in _without_comments(rival, packet)]


def _schedule_as_others() -> None:
    """Take back the real-time scheduling that SVT-AV1 gives all threads of a program of root's.

    It would stay, whatever the program starts would have it, too, and nothing else would run.
    """
    if not hasattr(os, "sched_setscheduler"):
        return
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):
            if os.sched_getscheduler(int(thread.name)) != os.SCHED_OTHER:
                os.sched_setscheduler(int(thread.name), os.SCHED_OTHER, os.sched_param(0))


def _code_by_program(
    rival: Rival, setting: RivalSetting, pictures: Sequence[Picture], fps: Fraction
) -> "list[Packet[Any]]":
    """See `code`; what a decoder needs before the first picture goes with its packet."""
    program = find_ffmpeg("encoders", rival.encoder)
    assert program is not None
    height, width = pictures[0].shape[:2]
    options = rival.realtime if setting.is_realtime else rival.best
    raw = ["-f", "rawvideo", "-pixel_format", "bgr24", "-video_size", f"{width}x{height}"]
    chosen = [word for name, value in options.items() for word in (f"-{name}", value)]
    coding = ["-c:v", rival.encoder, "-qp", str(setting.quality), *chosen, "-threads", "1"]
    rate = ["-framerate", str(fps / setting.frame_step)]
    with TemporaryDirectory() as folder:
        # A raw stream has all of it in its packets.
        path = str(Path(folder) / "coded.266")
        command = [program, "-v", "error", *raw, *rate, "-i", "-", *coding, "-f", rival.decoder]
        pieces = (picture.tobytes() for picture in pictures)
        run_program([*command, path], pieces, f"{rival.name} cannot code {width}x{height}")
        with av.open(path, format=rival.decoder) as container:
            return [packet for packet in container.demux(video=0) if packet.size]


def decoded(
    rival: Rival, packets: "Sequence[Packet[Any]]", frame_step: int, size: tuple[int, int]
) -> Iterator[Picture]:
    """The pictures of coded packets at the source's rate and size (width, height)."""
    context = cast(VideoCodecContext, VideoCodecContext.create(rival.decoder, "r"))
    parts = (context.decode(packet) for packet in chain(packets, [None]))
    for frame in chain.from_iterable(parts):
        small = frame.to_ndarray(format="bgr24")
        picture = np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_LANCZOS4), np.uint8)
        for _ in range(frame_step):
            yield picture


def _frames(pictures: Sequence[Picture], time_base: Fraction) -> Iterator[VideoFrame]:
    for index, picture in enumerate(pictures):
        frame = VideoFrame.from_ndarray(picture, format="bgr24").reformat(format="yuv420p")
        frame.pts, frame.time_base = index, time_base
        yield frame


def _without_comments(rival: Rival, packet: "Packet[Any]") -> "list[Packet[Any]]":
    if rival.comments is None:
        return [packet]
    remove = BitStreamFilterContext(f"filter_units=remove_types={rival.comments}", rival.decoder)
    return [*remove.filter(packet), *remove.filter(None)]
