"""What a session tells its user and whoever looks at its inside, and how the user stops it."""

from collections.abc import Callable
from dataclasses import dataclass

from encoder.calls.model_states import ModelState
from encoder.coding.rdo_quantiser import CodedPacket
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.other_face import OtherFace
from protocol.link.interface import MessageCallback, ignore_message
from shared_model.arrays import Array

Progress = Callable[[int, int | None], None]


def _ignore(*arguments: object) -> None:
    pass


@dataclass(frozen=True, slots=True)
class CallEvents:
    """Each is called when it happens, in the thread of the frames.

    on_state: with the state that the model enters.
    on_mode: with a version that has a learned mode more, and that mode, coded.
    on_packet: with the components (n, k) of a packet's frames as they were fitted, and the packet.
    """

    on_state: Callable[[ModelState], None] = _ignore
    on_mode: Callable[[ModelVersion, bytes], None] = _ignore
    on_packet: Callable[[Array, CodedPacket], None] = _ignore


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
