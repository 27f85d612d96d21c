"""The frames of a source as a session takes them: limited, paced, timed, read ahead."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import Capture
from runtime.parallel import beside, prefetch
from shared_model.arrays import Picture


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


@contextmanager
def dropping_frames(capture: Capture) -> Iterator[None]:
    """Drop the frames that a live source gives while the `with` block runs."""
    with beside(capture.drop_frames_while) if capture.is_live else nullcontext():
        yield
