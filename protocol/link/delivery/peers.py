"""Presence of the decoders of a call, for its sender."""

from protocol.link.interface import MessageCallback


class PeerMonitor:
    """The decoders that are present.

    say: called with a line when the sender finds no decoder any more, or one again.
    """

    def __init__(self, say: MessageCallback) -> None:
        self._say = say
        self._present = 0
        self._any_joined = self._announced_empty = False

    def __len__(self) -> int:
        return self._present

    def update(self, present: int) -> None:
        """So many are present now."""
        self._present = present
        self._any_joined = self._any_joined or present > 0

    def poll(self) -> bool:
        """Whether a decoder is present; announces a change since the last call."""
        listens = self._present > 0
        if listens and self._announced_empty:
            self._say("somebody listens again")
        elif not listens and self._any_joined and not self._announced_empty:
            self._say("nobody listens any more; sending on")
        self._announced_empty = self._any_joined and not listens
        return listens
