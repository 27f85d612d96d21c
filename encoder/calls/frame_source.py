"""The frames of a source as a session takes them: limited, paced, timed, read ahead, delayed."""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import Capture
from runtime.parallel import beside, prefetch
from shared_model.arrays import Array, Picture


@dataclass(frozen=True, slots=True)
class FrameSource:
    """Reads frames (index, picture) of a capture until `stop`; each can be read once.

    max_frames: read no more; None: all.
    pace: no frame comes before its time at the source's own rate.
    """

    capture: Capture
    stats: SessionStats
    stop: Callable[[], bool]
    max_frames: int | None = None
    pace: bool = False

    @property
    def expected_frames(self) -> int | None:
        """How many frames there will be; None: not known."""
        counts = [n for n in (self.capture.frame_count, self.max_frames) if n is not None]
        return min(counts, default=None)

    def with_lookahead(self) -> Generator[tuple[int, Picture, Picture | None], None, None]:
        """The frames to encode, each with the one after it.

        That is None after the last frame, and where waiting for it would delay the call.
        """
        frames = self.frames()
        if self._is_realtime:
            for index, picture in frames:
                yield index, picture, None
            return
        current = next(frames, None)
        while current is not None:
            following = next(frames, None)
            yield *current, following[1] if following else None
            current = following

    def frames(self) -> Iterator[tuple[int, Picture]]:
        """The frames to encode; those of a recorded source are read in the background."""
        start = time.monotonic()
        frames = iter(self.capture) if self._is_realtime else prefetch(iter(self.capture))
        while not self.stop():
            with self.stats.stage("capture"):
                item = next(frames, None)
            if item is None or (self.max_frames is not None and item[0] >= self.max_frames):
                return
            if self.pace:
                early_s = start + self.capture.times.time_s(item[0]) - time.monotonic()
                time.sleep(max(0.0, early_s))
                self.stats.note_lag(-early_s)
            self.stats.note_captured(item[0])
            yield item

    def second_pass(
        self, count: int, progress: Callable[[int], None]
    ) -> Iterator[tuple[int, Picture]]:
        """The first `count` frames again, of a newly opened capture.

        progress: called with the number of frames taken.
        """
        frames = iter(self.capture)
        for number in range(count):
            with self.stats.stage("capture"):
                item = next(frames, None)
            if item is None or self.stop():
                return
            yield item
            progress(number + 1)

    @property
    def _is_realtime(self) -> bool:
        return self.pace or self.capture.is_live


@dataclass(frozen=True, slots=True, eq=False)
class SeenFrame:
    """A source frame that has been seen and is not coded yet.

    picture: (h, w, 3) BGR, empty where the camera is off.
    points: (468, 3) landmarks, pixels; None: no face was found.
    seen_s: when, by the call's clock.
    is_other: from this frame on it is the face of somebody else.
    is_between: its landmarks are not looked for, see `encoder.calls.frame_between`.
    """

    index: int
    picture: Picture
    points: Array | None
    seen_s: float
    is_other: bool = False
    is_between: bool = False


class FrameDelay:
    """Holds frames back for some time after they have been seen.

    delay_s: in the source's time.  fps: of the source.
    """

    def __init__(self, delay_s: float, fps: float) -> None:
        self._delay_s, self._frames = delay_s, round(delay_s * fps)
        self._seen = deque[SeenFrame]()

    def __bool__(self) -> bool:
        """Whether any frame has to wait."""
        return self._frames > 0

    @property
    def shows_face(self) -> bool:
        """Whether there is a face in a frame that waits."""
        return any(frame.points is not None for frame in self._seen)

    def add(self, frame: SeenFrame) -> None:
        """Add the newest frame."""
        self._seen.append(frame)

    def due(self, newest: int) -> Iterator[SeenFrame]:
        """The frames that have waited long enough when source frame `newest` has been seen."""
        while self._seen and self._seen[0].index <= newest - self._frames:
            yield self._seen.popleft()

    def rest(self, clock: Callable[[], float] | None) -> Iterator[SeenFrame]:
        """The frames that still wait.

        clock: that of `seen_s`, by which each waits its time; None: none waits any longer.
        """
        while self._seen:
            frame = self._seen.popleft()
            if clock is not None:
                time.sleep(max(0.0, frame.seen_s + self._delay_s - clock()))
            yield frame


@contextmanager
def dropping_frames(capture: Capture) -> Iterator[None]:
    """Drop the frames that a live source gives while the `with` block runs."""
    with beside(capture.drop_frames_while) if capture.is_live else nullcontext():
        yield
