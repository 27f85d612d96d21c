"""When a live call learns single modes between its models, and from what."""

from collections import deque
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial

from encoder.calls.model_version import Epoch
from encoder.learning.incremental_modes import (
    BYTES_PER_S,
    LOOKS_PER_S,
    MOST_LOOKS,
    Grower,
    Grown,
    Look,
)

# New modes come together at most this often: each costs the tracker a new template.
EVERY_S = 0.25
# How many looks from before an update are taken again, of these few nearly all.
FIRST_LOOKS = MOST_LOOKS // 2


class LiveModes:
    """Keeps what the call has shown lately, and learns from it beside the frames.

    fps: of the source.  pool: where to learn; None: at once, before the next frame.
    """

    def __init__(self, fps: float, pool: Executor | None) -> None:
        self._fps, self._pool = fps, pool
        self._recent: deque[Look] = deque(maxlen=MOST_LOOKS)
        self._fresh = deque[Look](maxlen=self._recent.maxlen)
        self._grower: Grower | None = None
        self._learning: Future[list[Grown]] | None = None
        self._looked_at = self._grown_at = float("-inf")
        self._room_bytes = 0.0

    def start(self, epoch: Epoch) -> None:
        """From now on learn what this model lacks; what is being learned is of the one before."""
        # Not by the epoch's drawing: when its tracker is taught a mode, that one is not.
        self._grower = Grower(epoch.learned.caller, epoch.explain)
        self._fresh.clear()
        newest = list(self._recent)[-FIRST_LOOKS:]
        self._fresh.extend(replace(look, face=None) for look in newest)
        self._learning = None

    def wants(self, index: int) -> bool:
        """Whether source frame `index` should be looked at."""
        return index - self._looked_at >= self._fps / LOOKS_PER_S

    def look(self, index: int, look: Look) -> None:
        """Source frame `index`."""
        self._looked_at = index
        self._recent.append(look)
        self._fresh.append(look)

    def grown(self, index: int, most: int, due: bool) -> list[Grown]:
        """Modes that have been learned by source frame `index`.

        due: goes on with at most `most`, if it is time.
        """
        if self._learning is not None:
            if not self._learning.done():
                return []
            found, self._learning = self._learning.result(), None
            return self._spent(found)
        early = index - self._grown_at < EVERY_S * self._fps
        if early or not due or not self._fresh or not most:
            return []
        earned = BYTES_PER_S * min(1.0, (index - self._grown_at) / self._fps)
        self._room_bytes = min(self._room_bytes + earned, BYTES_PER_S)
        self._grown_at = index
        assert self._grower is not None
        looks = list(self._fresh)
        self._fresh.clear()
        job = partial(self._grower.grow, looks, self._room_bytes, most)
        if self._pool is None:
            return self._spent(job())
        self._learning = self._pool.submit(job)
        return []

    def _spent(self, found: list[Grown]) -> list[Grown]:
        self._room_bytes -= sum(len(mode.data) for mode in found)
        return found
