"""Presence of the decoders of a call, for its sender."""

from collections.abc import Set

from protocol.link.interface import MessageCallback

# Python handles Ctrl-C between two waits: the signal may be delivered to a thread of Zenoh.
POLL_S = 0.1


class PeerMonitor:
    """The decoders that are present.

    say: called with a line when the sender finds no decoder any more, or one again.
    """

    def __init__(self, say: MessageCallback) -> None:
        self._say = say
        self._present: Set[str] = frozenset()
        self._any_joined = self._announced_empty = False

    def __len__(self) -> int:
        return len(self._present)

    def update(self, present: Set[str]) -> None:
        """These are present now."""
        self._present = frozenset(present)
        self._any_joined = self._any_joined or bool(present)

    def poll(self) -> bool:
        """Whether a decoder is present; announces a change since the last call."""
        listens = bool(self._present)
        if listens and self._announced_empty:
            self._say("somebody listens again")
        elif not listens and self._any_joined and not self._announced_empty:
            self._say("nobody listens any more; sending on")
        self._announced_empty = self._any_joined and not listens
        return listens
