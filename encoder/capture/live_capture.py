"""A camera whose frames are numbered by the clock: a slow encoder misses some of them.

A thread or another program puts each frame into a mailbox; the encoder takes the newest.  The index
of a frame is the time at which it was taken, in periods of the frame rate.  So indices are skipped
for frames that the encoder did not take, or that the camera left out in the dark.
"""

import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from threading import Condition, Thread

import numpy as np

from encoder.capture.frame_times import FrameTimes
from encoder.capture.picture_size import MAX_PICTURE_PX, letterboxed, reduced
from encoder.capture.video_source import Capture, open_source
from shared_model.arrays import Picture

# Stands for a frame while the camera is off.
NO_PICTURE: Picture = np.zeros((0, 0, 3), np.uint8)
# A frame may come by so many periods before its time; one that comes sooner is left out.
EARLY_FRAMES = 0.8
# How long who waits for a frame waits at once: Python handles Ctrl-C in between.
NAP_S = 0.1
# A camera that gives nothing for so long is taken as off: the call, and the voice in it, go on.
STALL_S = 0.5
# By how much a frame of a file may come after its time and still keep it.
MAX_LATE_S = 0.25


class FrameMailbox:
    """Holds the newest frame of a camera until it is taken; any thread may put one in.

    While the camera is off, or gives nothing any more, `NO_PICTURE` comes out at the rate of the
    frames.
    """

    def __init__(self, fps: Fraction, clock: Callable[[], float] = time.monotonic) -> None:
        self._period_s, self._clock = float(1 / fps), clock
        self._changed = Condition()
        self._newest: tuple[float, Picture] | None = None
        self._last_s: float | None = None  # when a frame was put in
        self._is_off = self._is_closed = False
        self._error: BaseException | None = None

    @property
    def is_closed(self) -> bool:
        """Whether no further frame is taken."""
        return self._is_closed

    def put(self, picture: Picture, time_s: float) -> None:
        """A frame (h, w, 3) uint8 BGR, taken at `time_s` of the clock; replaces one not taken."""
        with self._changed:
            self._newest, self._last_s = (time_s, picture), self._clock()
            self._changed.notify_all()

    def switch(self, on: bool) -> None:
        """Switch the camera on or off."""
        with self._changed:
            self._is_off = not on
            self._changed.notify_all()

    def close(self, error: BaseException | None = None) -> None:
        """No further frame comes.  error: raised by who takes one."""
        with self._changed:
            self._is_closed, self._error = True, error
            self._changed.notify_all()

    def take(self) -> tuple[float, Picture] | None:
        """Wait for a frame and the time at which it was taken; None after the last one."""
        with self._changed:
            while not self._is_closed:
                if self._is_off or self._is_stalled:
                    self._changed.wait(self._period_s)
                    if self._is_off:
                        self._newest = None
                    if self._newest is None:
                        return self._clock(), NO_PICTURE
                if self._newest is not None:
                    newest, self._newest = self._newest, None
                    return newest
                self._changed.wait(NAP_S)
        if self._error is not None:
            raise self._error
        return None

    @property
    def _is_stalled(self) -> bool:
        if self._newest is not None or self._last_s is None:
            return False
        return self._clock() - self._last_s > STALL_S


class _FirstPicture:
    """Reads the first picture that a mailbox gets, for a `Capture` to take the size of."""

    def __init__(self, mailbox: FrameMailbox) -> None:
        self._mailbox = mailbox

    @property
    def notes(self) -> list[str]:
        """See `Reader`: there are none."""
        return []

    def read(self) -> Picture | None:
        while (taken := self._mailbox.take()) is not None:
            if taken[1].size:
                return taken[1]
        return None

    def close(self) -> None:
        self._mailbox.close()


class LiveCapture(Capture):
    """The frames of a mailbox as a source, see above; waits for the first one.

    origin: the source whose frames the mailbox gets, if that is one.
    Raises `UserError` if the mailbox is closed before.
    """

    def __init__(
        self, name: str, mailbox: FrameMailbox, fps: Fraction, origin: Capture | None = None
    ) -> None:
        self._mailbox, self._origin = mailbox, origin
        self._start_s: float | None = None
        super().__init__(name, _FirstPicture(mailbox), FrameTimes(fps), None, is_live=True)
        if origin is not None:
            self.colour_matrix, self.sample_aspect = origin.colour_matrix, origin.sample_aspect

    @property
    def notes(self) -> list[str]:
        """See `Capture`."""
        return [] if self._origin is None else self._origin.notes

    @property
    def start_s(self) -> float | None:
        """The time of frame 0; None before it is taken."""
        return self._start_s

    def __iter__(self) -> Iterator[tuple[int, Picture]]:
        """Yield (index, frame); frames of another size are fitted into that of the first."""
        upcoming = 0
        while (taken := self._mailbox.take()) is not None:
            time_s, picture = taken
            if self._start_s is None:
                self._start_s = time_s
            position = (time_s - self._start_s) * float(self.fps)
            if position < upcoming - EARLY_FRAMES:
                continue
            index = max(upcoming, round(position))
            upcoming = index + 1
            yield index, self._fitted(picture)

    def drop_frames_while(
        self, busy: Callable[[], bool], look: Callable[[Picture], None] = lambda picture: None
    ) -> None:
        """See `Capture`."""
        while busy() and (taken := self._mailbox.take()) is not None:
            look(self._fitted(taken[1]))

    def _fitted(self, picture: Picture) -> Picture:
        return letterboxed(picture, self.width, self.height) if picture.size else picture


def read_camera(
    source: str,
    mailbox: FrameMailbox,
    capture: Capture,
    repeat: bool,
    on_start: Callable[[float], None] = lambda start_s: None,
    max_pixels: int = MAX_PICTURE_PX,
) -> Thread:
    """Start a thread that puts the frames of an open source into a mailbox, each at its time.

    An error of the source is raised by who takes frames out of the mailbox.
    repeat: begin a file again at its end.  on_start: called with the time of each beginning.
    max_pixels: larger pictures are reduced.
    """

    def work() -> None:
        start_s = time.monotonic()
        try:
            with capture:
                on_start(start_s)
                start_s = _read_all(capture, mailbox, start_s, max_pixels)
            while repeat and not capture.is_live and not mailbox.is_closed:
                with open_source(source, square_pixels=True) as again:
                    on_start(start_s)
                    start_s = _read_all(again, mailbox, start_s, max_pixels)
            mailbox.close()
        except BaseException as error:
            # Whatever it is, who waits for a frame would wait for ever.
            mailbox.close(error)

    thread = Thread(target=work, daemon=True)
    thread.start()
    return thread


def by_arrival(capture: Capture) -> LiveCapture:
    """A live source with its frames counted by the time at which they come.

    A camera that gives fewer frames than it says, as in the dark, is shown at the pace of the
    world.  Closing the result closes `capture`.
    """
    mailbox = FrameMailbox(capture.fps)
    size = capture.width * capture.height
    read_camera(capture.name, mailbox, capture, repeat=False, max_pixels=size)
    return LiveCapture(capture.name, mailbox, capture.fps, capture)


def _read_all(capture: Capture, mailbox: FrameMailbox, start_s: float, max_pixels: int) -> float:
    """Put in the frames; returns when one more would be due.

    A file that is read more slowly than it plays falls behind the clock, and not the call with it.
    """
    due_s = start_s
    for index, picture in capture:
        due_s = start_s if capture.is_live else start_s + capture.times.time_s(index)
        if (early_s := due_s - time.monotonic()) > 0:
            time.sleep(early_s)
        if mailbox.is_closed:
            break
        now_s = time.monotonic()
        taken_s = now_s if capture.is_live else max(due_s, now_s - MAX_LATE_S)
        mailbox.put(reduced(picture, max_pixels), taken_s)
    return max(due_s + float(1 / capture.fps), time.monotonic() - MAX_LATE_S)
