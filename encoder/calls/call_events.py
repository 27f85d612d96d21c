"""What a live call tells whoever looks at its inside: a debugger, an experiment, a test."""

from collections.abc import Callable
from dataclasses import dataclass

from encoder.calls.model_states import ModelState
from encoder.coding.rdo_quantiser import CodedPacket
from encoder.live_model.model_version import ModelVersion
from shared_model.arrays import Array


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
