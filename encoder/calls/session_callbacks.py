"""What a run of the encoder says to its user while it goes on, and hears from them."""

from collections.abc import Callable
from dataclasses import dataclass

from protocol.link.interface import Say, silent

Progress = Callable[[int, int | None], None]


@dataclass(frozen=True, slots=True)
class Console:
    """The user's end of a run.

    progress: called with the number of frames so far and of the whole source, if that is known.
    stop: asked between frames.
    say: takes a line about a call over a network: whom it waits for, whether anybody listens.
    preparing: takes what is done before there is anything to keep, and "" once there may be.
    """

    progress: Progress
    stop: Callable[[], bool]
    say: Say = silent
    preparing: Say = silent
