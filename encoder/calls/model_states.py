"""The states of a live call's model, and what leads from one to the next.

| state | meanwhile | ends when | next |
| --- | --- | --- | --- |
| SEARCHING | no frame shows a face | one is coded that does; the first version is sent | CODING |
| CODING | modes are learned for the version in use | an update is due, the link idle | TRAINING |
| TRAINING | the update is trained | it is done, the link idle | SENDING_LAYERS or ANNOUNCED |
| SENDING_LAYERS | layers of the update are sent | enough are; its packet is sent | ANNOUNCED |
| ANNOUNCED | the version in use codes frames | the switch is near | SWITCHING |
| SWITCHING | modes are learned for the update | its first packet is next | CODING |
| ENDED | nothing | | |

Only an update that is sent in layers passes through SENDING_LAYERS.  The call may end in any state.
"""

import logging
from collections.abc import Callable, Mapping
from enum import StrEnum

_log = logging.getLogger(__name__)


class ModelState(StrEnum):
    """What happens to the model; see the table above."""

    SEARCHING = "searching"
    CODING = "coding"
    TRAINING = "training"
    SENDING_LAYERS = "sending layers"
    ANNOUNCED = "announced"
    SWITCHING = "switching"
    ENDED = "ended"


class ModelEvent(StrEnum):
    """What ends a state."""

    FIRST_SENT = "the first version is sent"
    UPDATE_DUE = "an update is due"
    LAYERS_BEGUN = "the first layers of the update are sent"
    ANNOUNCED = "the packet of the update is sent"
    SWITCH_NEAR = "the switch is near"
    SWITCHED = "the next packet is of the update"
    CALL_ENDED = "the call has ended"


TRANSITIONS: Mapping[ModelState, Mapping[ModelEvent, ModelState]] = {
    ModelState.SEARCHING: {
        ModelEvent.FIRST_SENT: ModelState.CODING,
        ModelEvent.CALL_ENDED: ModelState.ENDED,
    },
    ModelState.CODING: {
        ModelEvent.UPDATE_DUE: ModelState.TRAINING,
        ModelEvent.CALL_ENDED: ModelState.ENDED,
    },
    ModelState.TRAINING: {
        ModelEvent.LAYERS_BEGUN: ModelState.SENDING_LAYERS,
        ModelEvent.ANNOUNCED: ModelState.ANNOUNCED,
        ModelEvent.CALL_ENDED: ModelState.ENDED,
    },
    ModelState.SENDING_LAYERS: {
        ModelEvent.ANNOUNCED: ModelState.ANNOUNCED,
        ModelEvent.CALL_ENDED: ModelState.ENDED,
    },
    ModelState.ANNOUNCED: {
        ModelEvent.SWITCH_NEAR: ModelState.SWITCHING,
        ModelEvent.CALL_ENDED: ModelState.ENDED,
    },
    ModelState.SWITCHING: {
        ModelEvent.SWITCHED: ModelState.CODING,
        ModelEvent.CALL_ENDED: ModelState.ENDED,
    },
    ModelState.ENDED: {},
}


class ModelStates:
    """The state of one call's model.

    on_state: called with each state that is entered.
    """

    def __init__(self, on_state: Callable[[ModelState], None]) -> None:
        self._state, self._on_state = ModelState.SEARCHING, on_state

    @property
    def state(self) -> ModelState:
        """The state now."""
        return self._state

    def may(self, event: ModelEvent) -> bool:
        """Whether the state ends by this."""
        return event in TRANSITIONS[self._state]

    def on(self, event: ModelEvent) -> None:
        """Enter the state that follows an event.  Raises `ValueError` if none does."""
        if not self.may(event):
            raise ValueError(f"model lifecycle: {self._state} does not end because {event}")
        self._state = TRANSITIONS[self._state][event]
        _log.info("%s: %s", self._state, event)
        self._on_state(self._state)
