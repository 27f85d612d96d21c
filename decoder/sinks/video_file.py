"""Video files: lossless H.264 or FFV1, or H.264 or VP9 as browsers play it; written by FFmpeg."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import av
import cv2
import numpy as np
from av.video.reformatter import (
    ColorPrimaries,
    ColorRange,
    Colorspace,
    ColorTrc,
    VideoReformatter,
)
from av.video.stream import VideoStream

from decoder.sinks.interface import FrameSink
from decoder.sinks.sound_stream import SoundStream
from decoder.sinks.y4m_stream import LUMA_SPAN, LUMA_WEIGHTS
from protocol.frames.frame_times import TICKS_PER_FRAME
from protocol.sample_aspect import shown_size
from shared_model.arrays import Picture, Samples
from shared_model.errors import UserError

# Container -> codec.
CODECS: dict[str, Literal["libx264rgb", "ffv1", "libx264", "libvpx-vp9"]] = {
    ".mkv": "libx264rgb",
    ".avi": "ffv1",
    ".mp4": "libx264",
    ".mov": "libx264",
    ".webm": "libvpx-vp9",
}
LOSSLESS = ("libx264rgb", "ffv1")
# Containers whose pictures may have times of their own.
TIMED = (".mkv", ".mp4", ".mov", ".webm")
# Options of FFmpeg's codecs: so fine that no loss is seen, in the time of a picture.
OPTIONS: dict[str, dict[str, str]] = {
    # A fifth of FFV1's time, and less than half of its bytes where a part of the picture rests.
    "libx264rgb": {"qp": "0", "preset": "ultrafast", "tune": "zerolatency", "threads": "1"},
    "ffv1": {},
    "libx264": {"crf": "6", "preset": "veryfast", "bf": "0"},
    "libvpx-vp9": {"crf": "6", "b": "0", "deadline": "good", "cpu-used": "5", "row-mt": "1"},
}
# The index of what is served over a network comes first.
FASTSTART = {"movflags": "+faststart"}
# Pixel format with colour differences of half the resolution.
CHROMA_SUBSAMPLED = "yuv420p"
# Tag of the files of a call, by its colour matrix.
TAGS: dict[str, Colorspace | None] = {"bt601": None, "bt709": Colorspace.ITU709}
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
MATROSKA_OPTIONS = {"write_crc": "0"}


@dataclass(frozen=True, slots=True)
class _PixelFormat:
    """FFmpeg's pixel format of a file, and the matrix of its Y'CbCr.

    matrix: None: RGB, or Y'CbCr by BT.601 without a tag.
    """

    pixel_format: str
    matrix: Colorspace | None


class VideoFileSink(FrameSink):
    """Writes a video file under a temporary name and renames it when it is finished.

    Leaving the `with` block by an exception finishes it too, so that a stopped recording can be
    played; it keeps the temporary name if there is an older file, which may be complete.
    Without any picture no file is left.

    is_variable: pictures have times of their own, and `fps` is the mean rate.
    sound_rate_hz: samples per second of the sound track; None: the file has none.
    sample_aspect: width of a pixel over its height.
    """

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        fps: Fraction,
        matrix: str,
        is_variable: bool = False,
        sound_rate_hz: int | None = None,
        sample_aspect: Fraction = Fraction(1),
    ) -> None:
        self._path, self._shape = path, (height, width, 3)
        self._part = path.with_name(f"{path.stem}.part{path.suffix}")
        self._reformatter, self._colours = VideoReformatter(), _pixel_format(path, matrix)
        if width % 2 or height % 2:
            self._colours = _of_odd_size(self._colours, path)
        weights = LUMA_WEIGHTS["bt709" if self._colours.matrix else "bt601"]
        self._luma = LUMA_SPAN * np.array([weights], np.float32)
        self._next_pts, self._is_open, self._replaces = 0, True, True
        self._has_failed = False  # the disk has refused: the file is torn
        self._is_variable = is_variable
        is_matroska = path.suffix.lower() == ".mkv" and sample_aspect != 1
        self._writes_aspect = sample_aspect if is_matroska else None
        with self._as_user_error(), ExitStack() as undo:
            undo.callback(self._remove_part)
            options = FASTSTART if CODECS[path.suffix.lower()] == "libx264" else {}
            if self._writes_aspect is not None:
                options = MATROSKA_OPTIONS
            opened = av.open(str(self._part), "w", container_options=options)
            self._container = undo.enter_context(opened)
            self._stream = self._add_stream(width, height, fps, is_variable)
            if sample_aspect != 1:
                self._stream.codec_context.sample_aspect_ratio = sample_aspect
            if self._writes_aspect is not None:
                make_room_for_aspect(self._stream)
            self._sound = (
                None
                if sound_rate_hz is None
                else SoundStream(self._container, path.suffix.lower(), sound_rate_hz)
            )
            self._container.start_encoding()
            undo.pop_all()

    def write(self, picture: Picture, time_s: Fraction | None = None) -> None:
        """Add one picture; `time_s` is of no effect unless the rate varies.

        Raises `ValueError` if it is of another size, `UserError` if the disk refuses.
        """
        if picture.shape != self._shape:
            raise ValueError(f"picture has shape {picture.shape}, expected {self._shape}")
        frame = self._reformatter.reformat(
            av.VideoFrame.from_ndarray(picture, format="bgr24"),
            format=self._colours.pixel_format,
            dst_colorspace=self._colours.matrix,
            dst_color_range=ColorRange.MPEG if self._colours.matrix else None,
        )
        if self._colours.pixel_format == CHROMA_SUBSAMPLED:
            self._correct_luma(frame, picture)
        if self._is_variable and time_s is not None:
            # No two pictures may have one time.
            self._next_pts = max(round(time_s / self._time_base), self._next_pts)
        frame.pts = self._next_pts
        with self._as_user_error():
            self._container.mux(self._stream.encode(frame))
        self._next_pts += 1

    def write_sound(self, samples: Samples) -> None:
        """Add samples, (n,) int16, to the sound track.  Raises `UserError` if the disk refuses."""
        if self._sound is not None:
            with self._as_user_error():
                self._sound.write(samples)

    def close(self) -> None:
        """Finish and rename the file; closing twice has no further effect.

        Raises `UserError` if the disk refuses; the file keeps its temporary name then.
        """
        if not self._is_open:
            return
        self._is_open = False
        try:
            with self._as_user_error(), self._container:
                self._container.mux(self._stream.encode(None))
                if self._sound is not None:
                    self._sound.finish()
            if self._next_pts and self._writes_aspect is not None:
                height, width, _ = self._shape
                state_aspect(self._part, width, height, self._writes_aspect)
        finally:
            if not self._next_pts:
                self._remove_part()
            elif self._replaces and not self._has_failed:
                self._part.replace(self._path)

    def mark_incomplete(self) -> Path | None:
        """See `FrameSink`."""
        self._replaces = not (self._is_open and self._path.exists())
        return None if self._replaces else self._part

    @contextmanager
    def _as_user_error(self) -> Iterator[None]:
        try:
            yield
        except av.FFmpegError as error:
            self._has_failed = True
            rest = f"; what was written is in {self._part}" if self._next_pts else ""
            raise UserError(f"cannot write {self._path}: {error.strerror}{rest}") from error

    def _remove_part(self) -> None:
        # A file system that takes no file refuses this as well.
        with suppress(OSError):
            self._part.unlink(missing_ok=True)

    def _correct_luma(self, frame: av.VideoFrame, picture: Picture) -> None:
        """Add to a frame's luma what a reader would lose of the picture's.

        FFmpeg's conversion to subsampled colours rounds down, by two grey levels on skin.  Source
        pictures have lost that once already.
        """
        read = self._reformatter.reformat(
            frame, format="bgr24", src_colorspace=self._colours.matrix
        ).to_ndarray()
        deficit = cv2.transform(cv2.subtract(picture, read, dtype=cv2.CV_32F), self._luma)
        height, width = deficit.shape
        plane = frame.planes[0]
        luma = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[
            :height, :width
        ]
        cv2.add(luma, deficit, luma, dtype=cv2.CV_8U)

    def _add_stream(self, width: int, height: int, fps: Fraction, is_variable: bool) -> VideoStream:
        codec = CODECS[self._path.suffix.lower()]
        options, is_rgb = OPTIONS[codec], self._colours.matrix is None
        # That of RGB takes nothing else.
        encoder = "libx264" if codec == "libx264rgb" and not is_rgb else codec
        stream = self._container.add_stream(encoder, rate=fps, options=options)
        self._time_base = 1 / (fps * TICKS_PER_FRAME if is_variable else fps)
        stream.codec_context.time_base = self._time_base
        stream.width, stream.height = width, height
        stream.pix_fmt = self._colours.pixel_format
        if self._colours.matrix is not None:
            context = stream.codec_context
            context.colorspace, context.color_range = self._colours.matrix, ColorRange.MPEG
            context.color_primaries, context.color_trc = ColorPrimaries.BT709, ColorTrc.BT709
        return stream


def _pixel_format(path: Path, matrix: str) -> _PixelFormat:
    """The pixel format of the pictures of a call with this colour matrix in the file `path`."""
    if matrix not in TAGS:
        raise ValueError(f"matrix is {matrix!r}, expected one of {', '.join(TAGS)}")
    tag = TAGS[matrix]
    if CODECS[path.suffix.lower()] not in LOSSLESS:
        return _PixelFormat(CHROMA_SUBSAMPLED, tag)
    # AVI cannot be tagged.
    if tag is None or path.suffix.lower() == ".avi":
        return _PixelFormat("bgr0", None)
    return _PixelFormat("yuv444p", tag)


def _of_odd_size(colours: _PixelFormat, path: Path) -> _PixelFormat:
    """H.264 has no odd sizes with colour differences of half the resolution."""
    if CODECS[path.suffix.lower()] != "libx264":
        return colours
    return _PixelFormat("yuv444p", colours.matrix)


def make_room_for_aspect(stream: VideoStream) -> None:
    """Before the header is written."""
    stream.set_display_rotation(90)


def state_aspect(path: Path, width: int, height: int, aspect: Fraction) -> None:
    """State it in a finished file of such a stream.  width, height: of the pictures."""
    shown = shown_size(width, height, aspect)
    sides = [min(side, MAX_SIDE_PX).to_bytes(2, "big") for side in shown]
    elements = _DISPLAY_WIDTH + sides[0] + _DISPLAY_HEIGHT + sides[1] + _VOID + bytes(2)
    assert len(elements) == _PROJECTION_BYTES
    with path.open("r+b") as file:
        head = file.read(_HEAD_BYTES)
        for before, after in ((_PROJECTION, elements), (_UNKNOWN_UNIT, _PIXEL_UNIT)):
            file.seek(head.index(before))
            file.write(after)
