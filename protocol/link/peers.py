"""Presence of the decoders of a call, for its sender."""

import threading
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic

from protocol.link.interface import MessageCallback

# Python handles Ctrl-C between two waits: the signal may be delivered to a thread of Zenoh.
POLL_S = 0.1


class PeerMonitor:
    """The decoders that are present; any thread reports who joins or leaves.

    say: called with a line when the sender finds no decoder any more, or one again.
    """

    def __init__(self, say: MessageCallback) -> None:
        self._say = say
        self._present: frozenset[str] = frozenset()
        self._lock, self._joined = threading.Lock(), SimpleQueue[None]()
        self._any_joined = self._announced_empty = False

    def __len__(self) -> int:
        return len(self._present)

    def on_join(self, who: str) -> None:
        """`who` has joined."""
        with self._lock:
            self._present |= {who}
            self._any_joined = True
        self._joined.put(None)

    def on_leave(self, who: str) -> None:
        """`who` has left."""
        with self._lock:
            self._present -= {who}

    def wait(self, timeout_s: float) -> bool:
        """Wait at most `timeout_s` for a decoder; whether one is present."""
        deadline = monotonic() + timeout_s
        while not self._present and (remaining_s := deadline - monotonic()) > 0:
            with suppress(Empty):
                self._joined.get(timeout=min(remaining_s, POLL_S))
        return bool(self._present)

    def poll(self) -> bool:
        """Whether a decoder is present; announces a change since the last call."""
        listens = bool(self._present)
        if listens and self._announced_empty:
            self._say("somebody listens again")
        elif not listens and self._any_joined and not self._announced_empty:
            self._say("nobody listens any more; sending on")
        self._announced_empty = self._any_joined and not listens
        return listens
