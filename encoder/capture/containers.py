"""Containers of video and sound, opened by PyAV, and what can be read of a stream."""

from collections.abc import Callable, Generator
from math import inf
from typing import TypeVar

import av
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import InputContainer
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from shared_model.errors import UserError

Frame = TypeVar("Frame", VideoFrame, AudioFrame)

# How long a network stream may take to open, and to give something, seconds.
TIMEOUT_S = 10.0


def open_container(name: str, address: str, is_remote: bool = False) -> InputContainer:
    """The container at an address, opened for reading.  Raises `UserError` with its name."""
    timeout = TIMEOUT_S if is_remote else None
    try:
        return av.open(address, metadata_errors="ignore", timeout=timeout)
    except (av.FFmpegError, OSError) as error:
        if is_remote:
            raise UserError(f"{name} does not answer or is not a video stream") from error
        raise UserError(f"{name} is not a video that can be read") from error


def shown_video(container: InputContainer) -> VideoStream | None:
    """The video that the container shows, else its largest; None: it has none but covers."""
    streams = [each for each in container.streams.video if not _is_cover(each)]
    return max(streams, key=_rank, default=None)


def video_stream(container: InputContainer, name: str) -> VideoStream:
    """As `shown_video`.  Raises `UserError` if there is none."""
    stream = shown_video(container)
    if stream is not None:
        return stream
    if container.streams.audio:
        raise UserError(f"{name} has sound only, no video")
    raise UserError(f"{name} has no video")


def readable_frames(
    container: InputContainer,
    stream: VideoStream | AudioStream,
    kind: type[Frame],
    on_damage: Callable[[], None] = lambda: None,
    max_damaged: float = inf,
) -> Generator[Frame, None, bool]:
    """The frames of a stream, in the order of time; damaged packets are passed over.

    kind: `VideoFrame` or `AudioFrame`, as the stream is.
    on_damage: called for each damaged packet.  max_damaged: after more of them the rest is left.
    Returns whether the container itself is damaged: what follows cannot be told apart any more.
    """
    packets, damaged = container.demux(stream), 0
    while damaged <= max_damaged:
        try:
            packet = next(packets, None)
        except av.FFmpegError:
            return True
        if packet is None:
            return False
        try:
            yield from (frame for frame in packet.decode() if isinstance(frame, kind))
        except av.FFmpegError:
            damaged += 1
            on_damage()
    return False


def _is_cover(stream: VideoStream) -> bool:
    return bool(stream.disposition & Disposition.attached_pic)


def _rank(stream: VideoStream) -> tuple[bool, int]:
    return bool(stream.disposition & Disposition.default), stream.width * stream.height
