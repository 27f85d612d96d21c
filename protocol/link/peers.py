"""Who listens to a call, as its sender hears of them."""

import threading
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic

from protocol.link.interface import Say

# Python hears Ctrl-C between two waits at the latest: Zenoh's threads, too, may take the signal.
POLL_S = 0.1


class Audience:
    """The decoders of a call: any thread says who comes and goes, the sender looks who is there.

    say: takes a line when the sender finds that the last has gone, or somebody is there again.
    """

    def __init__(self, say: Say) -> None:
        self._say = say
        self._there: frozenset[str] = frozenset()
        self._lock, self._came = threading.Lock(), SimpleQueue[None]()
        self._heard = self._alone = False

    def __len__(self) -> int:
        return len(self._there)

    def came(self, who: str) -> None:
        """`who` is there."""
        with self._lock:
            self._there |= {who}
            self._heard = True
        self._came.put(None)

    def went(self, who: str) -> None:
        """`who` is there no more."""
        with self._lock:
            self._there -= {who}

    def wait(self, timeout_s: float) -> bool:
        """Whether anybody is there within `timeout_s`."""
        deadline = monotonic() + timeout_s
        while not self._there and (left_s := deadline - monotonic()) > 0:
            with suppress(Empty):
                self._came.get(timeout=min(left_s, POLL_S))
        return bool(self._there)

    def look(self) -> bool:
        """Whether anybody is there now; news of that is said."""
        listens = bool(self._there)
        if listens and self._alone:
            self._say("somebody listens again")
        elif not listens and self._heard and not self._alone:
            self._say("nobody listens any more; sending on")
        self._alone = self._heard and not listens
        return listens
