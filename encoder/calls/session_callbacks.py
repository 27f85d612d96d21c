"""What a session tells its user while it runs, and how the user stops it."""

from collections.abc import Callable
from dataclasses import dataclass

from encoder.calls.call_events import CallEvents
from encoder.live_model.other_face import OtherFace
from protocol.link.interface import MessageCallback, ignore_message

Progress = Callable[[int, int | None], None]


@dataclass(frozen=True, slots=True)
class SessionCallbacks:
    """The user's end of a session.

    progress: called with the number of frames so far, and of the whole source or None.
    stop: whether to stop; asked between frames.
    on_message: called with a line about the link: for whom it waits, whether anybody listens.
    other_face: what is shown instead of the caller's face, in a live call; None: nothing.
    events: of a live call; None: nobody looks.
    on_preparing: called with what is done before anything is sent, and with "" when that is over.
    """

    progress: Progress
    stop: Callable[[], bool]
    on_message: MessageCallback = ignore_message
    on_preparing: MessageCallback = ignore_message
    other_face: OtherFace | None = None
    events: CallEvents | None = None
