"""Who listens to a call, as its sender hears of them."""

import threading
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic

from protocol.link.interface import MessageCallback

# Python hears Ctrl-C between two waits at the latest: Zenoh's threads, too, may take the signal.
POLL_S = 0.1


class PeerMonitor:
    """The decoders of a call: any thread says who comes and goes, the sender looks who is there.

    say: takes a line when the sender finds that the last has gone, or somebody is there again.
    """

    def __init__(self, say: MessageCallback) -> None:
        self._say = say
        self._present: frozenset[str] = frozenset()
        self._lock, self._joined = threading.Lock(), SimpleQueue[None]()
        self._any_joined = self._announced_empty = False

    def __len__(self) -> int:
        return len(self._present)

    def on_join(self, who: str) -> None:
        """`who` is there."""
        with self._lock:
            self._present |= {who}
            self._any_joined = True
        self._joined.put(None)

    def on_leave(self, who: str) -> None:
        """`who` is there no more."""
        with self._lock:
            self._present -= {who}

    def wait(self, timeout_s: float) -> bool:
        """Whether anybody is there within `timeout_s`."""
        deadline = monotonic() + timeout_s
        while not self._present and (left_s := deadline - monotonic()) > 0:
            with suppress(Empty):
                self._joined.get(timeout=min(left_s, POLL_S))
        return bool(self._present)

    def poll(self) -> bool:
        """Whether anybody is there now; news of that is said."""
        listens = bool(self._present)
        if listens and self._announced_empty:
            self._say("somebody listens again")
        elif not listens and self._any_joined and not self._announced_empty:
            self._say("nobody listens any more; sending on")
        self._announced_empty = self._any_joined and not listens
        return listens
