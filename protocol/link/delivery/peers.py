"""Presence of the decoders of a call, for its sender, and of its encoder, for a receiver."""

from protocol.link.interface import MessageCallback

# After what silence a decoder says so, and gives a call up that has begun.
SILENT_S, LOST_S = 5.0, 120.0


class EncoderMonitor:
    """The encoder of a call that has begun.

    say: called with a line when it has become silent, and when it is heard again.
    grace_s: how long a call without END waits for more once its encoder has said that it leaves.
    """

    def __init__(self, say: MessageCallback, grace_s: float) -> None:
        self._say, self._grace_s = say, grace_s
        self._is_silent = False

    def is_over(self, silent_s: float, has_left: bool) -> bool:
        """Whether no more is to be expected of an encoder that has been silent for so long."""
        if (silent_s > SILENT_S) != self._is_silent and not has_left:
            self._is_silent = not self._is_silent
            self._say(
                "nothing comes from the encoder; waiting for it"
                if self._is_silent
                else "the encoder is there again"
            )
        return silent_s > (self._grace_s if has_left else LOST_S)


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
