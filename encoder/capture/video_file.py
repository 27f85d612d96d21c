"""Frames of a video file, a pipe or a network stream, read by PyAV as they are to be shown.

Interlaced pictures are deinterlaced, those of high dynamic range are tone-mapped, the display
matrix is applied, and pictures of another size than the first are fitted into that.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import TYPE_CHECKING, Any

import av
import cv2
import numpy as np
from av.filter import Graph
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from encoder.capture.containers import open_container, readable_frames, video_stream
from encoder.capture.frame_times import is_usable_fps
from encoder.capture.picture_size import in_square_pixels, letterboxed
from encoder.capture.time_stamps import TimeStamps, read_time_stamps
from protocol.sample_aspect import is_stretched, usable_aspect
from shared_model.arrays import Picture

if TYPE_CHECKING:
    from encoder.capture.tone_mapping import ToneMapper

# FFmpeg's number of the colour matrix BT.709, as in ITU-T H.273.
_BT709 = 1
# FFmpeg's numbers of transfer characteristics of high dynamic range.
_TRANSFER_NAMES = {16: "PQ", 18: "HLG"}
# One picture for each; what is progressive in between stays as it is.
FILTER, OPTIONS = "bwdif", "mode=send_frame:parity=auto:deint=interlaced"


def _display_matrix(frame: VideoFrame) -> bytes | None:
    data: Any = frame.side_data.get("DISPLAYMATRIX")
    return None if data is None else bytes(data)


class VideoFile:
    """Opens a video and reads its frames one by one.

    name, address: for messages, and for FFmpeg.  is_remote: it comes from the network.
    is_file: it can be read several times.  square_pixels: pictures are as a call has them.
    stated_fps: frame rate by the container; 0: none.
    time_stamps: of the frames, see `TimeStamps`.
    frame_count: number of frames by the container, of which some may be unreadable; None: unknown.
    colour_matrix, sample_aspect: see `Capture`.
    unread: frames that could not be read so far.
    Raises `UserError` if it has no video.
    """

    def __init__(
        self,
        name: str,
        address: str,
        is_remote: bool = False,
        is_file: bool = True,
        square_pixels: bool = False,
    ) -> None:
        self._container = open_container(name, address, is_remote)
        self._stream = video_stream(self._container, name)
        self._stream.thread_type = "AUTO"
        self.stated_fps = float(self._stream.guessed_rate or 0)
        self._name, self.unread, self._notes = name, 0, list[str]()
        self._size: tuple[int, int] | None = None  # rows, columns of the first picture
        self._reformatter = VideoReformatter()
        self._mapper: ToneMapper | None = None
        frames = self._decoded()
        first = next(frames, None)
        self._frames = chain([] if first is None else [first], frames)
        self.time_stamps = TimeStamps()
        if is_file and first is not None:
            self._read_time_stamps(name, address, first)
        self.frame_count = len(self.time_stamps.times_s) or self._stated_count()
        matrix = first.colorspace if first is not None else self._stream.codec_context.colorspace
        self.colour_matrix = "bt709" if matrix == _BT709 else "bt601"
        self.sample_aspect = self._aspect(first)
        self._square_pixels = square_pixels

    @property
    def notes(self) -> list[str]:
        """See `Reader`."""
        notes = [f"{self._name}: {note}" for note in self._notes]
        if self.unread:
            frames = "frame" if self.unread == 1 else "frames"
            notes.append(f"{self._name} is damaged: {self.unread} {frames} could not be read")
        return notes

    def read(self) -> Picture | None:
        """The next picture (h, w, 3) uint8 BGR; None after the last."""
        frame = next(self._frames, None)
        return None if frame is None else self._picture(frame)

    def close(self) -> None:
        """Close the container."""
        self._container.close()

    def _read_time_stamps(self, name: str, address: str, first: VideoFrame) -> None:
        with open_container(name, address) as container:
            stamps = read_time_stamps(container, video_stream(container, name))
        if stamps.times_s and first.pts is not None and first.time_base is not None:
            # A recording may begin between two key frames.
            stamps = stamps.starting_at(first.pts * first.time_base)
        self.time_stamps, self.unread = stamps, self.unread + stamps.missing
        if stamps.jumps:
            self._note("time stamps jump: pictures follow each other as if they did not")

    def _aspect(self, first: VideoFrame | None) -> Fraction:
        stream = self._stream
        stated = stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio
        if first is None:
            return Fraction(1)
        width, height = first.width, first.height
        if stated and orientation_of(_display_matrix(first)).is_transposed:
            stated, width, height = 1 / stated, height, width
        return usable_aspect(stated, width, height)

    def _stated_count(self) -> int | None:
        if self._stream.frames:
            return self._stream.frames
        duration_s = float((self._container.duration or 0) / av.time_base)
        is_known = is_usable_fps(self.stated_fps) and duration_s > 0
        return round(duration_s * self.stated_fps) or None if is_known else None

    def _decoded(self) -> Iterator[VideoFrame]:
        """All frames in the order in which they are shown."""
        deinterlacer: Deinterlacer | None = None
        for frame in self._readable():
            if deinterlacer is None and frame.interlaced_frame:
                deinterlacer = Deinterlacer()
                self._note("interlaced pictures are deinterlaced (bwdif)")
            if deinterlacer is None:
                yield frame
            else:
                yield from deinterlacer.add(frame)
        if deinterlacer is not None:
            yield from deinterlacer.rest()

    def _readable(self) -> Iterator[VideoFrame]:
        """The frames that can be read."""
        return readable_frames(self._container, self._stream, VideoFrame, self._count_unread)

    def _count_unread(self) -> None:
        self.unread += 1

    def _picture(self, frame: VideoFrame) -> Picture:
        transfer = frame.color_trc
        if transfer in _TRANSFER_NAMES:
            if self._mapper is None:
                # Few sources need it, and whoever only looks at a source does without Numba.
                from encoder.capture.tone_mapping import ToneMapper

                name = _TRANSFER_NAMES[transfer]
                self._mapper = ToneMapper(name)
                self._note(f"pictures of high dynamic range ({name}) are tone-mapped")
            picture = self._mapper.apply(self._converted(frame, "rgb48le"))
        else:
            picture = np.asarray(self._converted(frame, "bgr24"), np.uint8)
        picture = orientation_of(_display_matrix(frame)).apply(picture)
        if self._size is None:
            self._size = picture.shape[0], picture.shape[1]
        elif picture.shape[:2] != self._size:
            rows, columns = self._size
            self._note(f"the size of the pictures changes: all are fitted into {columns}x{rows}")
            picture = letterboxed(picture, columns, rows)
        if self._square_pixels and is_stretched(self.sample_aspect):
            aspect = self.sample_aspect
            self._note(f"pixels of {aspect.numerator}:{aspect.denominator} are coded as squares")
            picture = in_square_pixels(picture, aspect)
        return picture

    def _converted(self, frame: VideoFrame, pixel_format: str) -> NDArray[Any]:
        return self._reformatter.reformat(frame, format=pixel_format).to_ndarray()

    def _note(self, line: str) -> None:
        if line not in self._notes:
            self._notes.append(line)


@dataclass(frozen=True, slots=True)
class Orientation:
    """Rows and columns are exchanged first, where they are; then the sides are."""

    is_transposed: bool = False
    flips_columns: bool = False
    flips_rows: bool = False

    def apply(self, picture: Picture) -> Picture:
        """The picture (h, w, 3) as it is to be shown."""
        if self.is_transposed:
            picture = np.asarray(cv2.transpose(picture), np.uint8)
        if self.flips_columns or self.flips_rows:
            both = self.flips_columns and self.flips_rows
            picture = np.asarray(
                cv2.flip(picture, -1 if both else int(self.flips_columns)), np.uint8
            )
        return picture


UPRIGHT = Orientation()


def orientation_of(matrix: bytes | None) -> Orientation:
    """By a display matrix, which turns by multiples of 90 degrees and mirrors; None: as it is.

    The first two rows and columns of the matrix say where x and y go (`libavutil/display.h`).
    """
    if matrix is None:
        return UPRIGHT
    x_to_x, x_to_y, _, y_to_x, y_to_y = struct.unpack_from("<5i", matrix)
    if abs(x_to_y) > abs(x_to_x):
        return Orientation(True, flips_columns=y_to_x < 0, flips_rows=x_to_y < 0)
    return Orientation(False, flips_columns=x_to_x < 0, flips_rows=y_to_y < 0)


class Deinterlacer:
    """Takes frames in order and gives as many back, some later; a size of its own begins anew."""

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._format: tuple[int, int, str] | None = None

    def add(self, frame: VideoFrame) -> Iterator[VideoFrame]:
        """The frames that are ready after this one."""
        shape = frame.width, frame.height, frame.format.name
        if self._graph is None or shape != self._format:
            yield from self.rest()
            self._graph, self._format = _graph(frame), shape
        self._graph.vpush(frame)
        yield from self._ready()

    def rest(self) -> Iterator[VideoFrame]:
        """The frames that are left after the last one."""
        if self._graph is None:
            return
        self._graph.vpush(None)
        yield from self._ready()
        self._graph = None

    def _ready(self) -> Iterator[VideoFrame]:
        assert self._graph is not None
        while True:
            try:
                yield self._graph.vpull()
            except (av.BlockingIOError, av.EOFError):
                return


def _graph(frame: VideoFrame) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width,
        height=frame.height,
        format=frame.format,
        time_base=frame.time_base,
    )
    graph.link_nodes(source, graph.add(FILTER, OPTIONS), graph.add("buffersink")).configure()
    return graph
