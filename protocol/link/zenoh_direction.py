"""The directions of a two-way call, settled over Zenoh; see `direction`."""

import secrets
from collections.abc import Callable
from contextlib import suppress
from threading import Condition
from time import monotonic
from typing import Self

import zenoh
from zenoh.handlers import Callback

from protocol.endpoint import parse_remote_endpoint
from protocol.errors import ProtocolError
from protocol.link.direction import (
    ID_BYTES,
    Direction,
    DirectionMessage,
    DirectionNegotiation,
    direction_key,
    parse_direction,
)
from protocol.link.zenoh_session import open_session, zenoh_config
from protocol.link.zenoh_settings import client_settings, security_settings
from protocol.security.link_security import LinkSecurity

# How long to listen for another end, and how often to ask meanwhile.
LISTEN_S, ASK_S = 1.0, 0.2


class ZenohDirection:
    """Settles the direction of one end, and answers others until it is closed.

    endpoint: where both ends can be reached.  name: of the call.
    is_listener: this end sends in direction a in any case.
    on_change: called from a thread of Zenoh's with another direction than the one settled first.
    person: name of who is here.  on_other: called from a thread with what the other end says.
    Where the endpoint cannot be reached a listener has a, and who connects b.
    """

    def __init__(
        self,
        endpoint: str,
        name: str,
        security: LinkSecurity,
        is_listener: bool,
        on_change: Callable[[Direction], None],
        person: str = "",
        on_other: Callable[[DirectionMessage], None] = lambda message: None,
    ) -> None:
        identifier = secrets.token_bytes(ID_BYTES)
        self._negotiation = DirectionNegotiation(identifier, is_listener, person)
        self._on_other = on_other
        self._name, self._key = name, security.key or b""
        self._on_change, self._changed = on_change, Condition()
        self._session = _reach(endpoint, security)
        if self._session is not None:
            handler = Callback(self._receive, indirect=False)
            self._session.declare_subscriber(direction_key(name), handler)

    def settle(self) -> Direction:
        """The direction of this end; takes `LISTEN_S` where nobody is there yet."""
        negotiation = self._negotiation
        if self._session is None:
            return negotiation.direction or Direction.B
        end_s = monotonic() + LISTEN_S
        with self._changed:
            while negotiation.direction is None and monotonic() < end_s:
                self._say()
                self._changed.wait(ASK_S)
            negotiation.hear_nobody()
            self._say()
            return negotiation.direction or Direction.A

    def set_muted(self, is_muted: bool) -> None:
        """Say whether the microphone of this end is off."""
        with self._changed:
            if is_muted != self._negotiation.is_muted:
                self._negotiation.is_muted = is_muted
                self._say()

    def close(self) -> None:
        """Leave; closing twice has no further effect."""
        session, self._session = self._session, None
        if session is not None:
            with suppress(zenoh.ZError):
                session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _say(self) -> None:
        if self._session is not None:
            data = self._negotiation.message.serialise(self._name, self._key)
            with suppress(zenoh.ZError):
                self._session.put(direction_key(self._name), data)

    def _receive(self, sample: zenoh.Sample) -> None:
        message = parse_direction(sample.payload.to_bytes(), self._name, self._key)
        if message is None:
            return
        with self._changed:
            had_changed = self._negotiation.has_changed
            if self._negotiation.receive(message):
                self._say()
            direction = self._negotiation.direction
            has_changed = self._negotiation.has_changed and not had_changed
            other = self._negotiation.other
            self._changed.notify_all()
        if message is other:
            self._on_other(message)
        if has_changed and direction is not None:
            self._on_change(direction)


def _reach(endpoint: str, security: LinkSecurity) -> zenoh.Session | None:
    """A session with what listens at an endpoint; None: nothing does."""
    try:
        choices = parse_remote_endpoint(endpoint).choices
    except ProtocolError:
        return None
    for choice in sorted(choices, key=lambda each: not each.is_reliable):
        with suppress(zenoh.ZError):
            return open_session(zenoh_config(client_settings(choice) | security_settings(security)))
    return None
