"""What both ends of a call over a network have in common, whatever carries it."""

import atexit
from collections.abc import Callable
from time import monotonic, sleep
from typing import Self

from protocol.endpoint import CERTIFIED_SCHEMES
from protocol.link.connection import Carrier, Connector
from protocol.link.endpoints import Failure, why_not_reached
from protocol.link.interface import (
    POLL_S,
    Arrival,
    LinkOptions,
    MessageCallback,
    PacketProtection,
)
from protocol.link.link_service import Delivery, LinkService
from protocol.link.messages import Role
from shared_model.errors import LINK_FAILED, UserError

# Makes the carrier of a service, and opens what the end listens on.
CarrierFactory = Callable[[LinkService], Carrier]

# How often a farewell is repeated, and how soon.
FAREWELLS, FAREWELL_S = 3, 0.02
# How long the other end may answer who is there and say nothing that this end takes, and a relay
# that knows its peers may answer nothing.
UNREAD_S = 5.0


class LinkEnd:
    """What both ends have in common; closed on leaving the `with` block."""

    def __init__(
        self,
        options: LinkOptions,
        service: LinkService,
        make_carrier: CarrierFactory,
        say: MessageCallback,
        waiting_for: str,
    ) -> None:
        self._options, self._service, self._say = options, service, say
        self._begun_s, self._closed, self._told = monotonic(), False, False
        self._unread_s: float | None = None
        self._unanswered_s: float | None = None  # since when an open connection hears nothing
        if not options.listen:
            say(f"connecting to {' or '.join(options.connect)} for {waiting_for}")
        self._carrier = make_carrier(service)
        # No thread may be in a function of Zenoh while the interpreter ends.
        atexit.register(self._leave)
        try:
            if options.listen:
                say(f"listening on {' and '.join(options.listen)} for {waiting_for}")
            service.start(self._carrier)
            self._wait_for_link()
        except BaseException:
            self._leave()
            raise

    def close(self) -> None:
        """Deliver what was sent and leave; closing twice has no further effect."""
        if self._closed:
            return
        try:
            self._finish()
        finally:
            self._leave(self._farewell())

    def _finish(self) -> None:
        """Stay for as long as the other end may need it."""

    def _farewell(self) -> bytes | None:
        """What is sent at last; None: nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _wait_for_link(self) -> None:
        """Raise `UserError` if no connection can be opened in time."""
        connector, timeout_s = self._service.connector, self._options.connect_timeout_s
        where = " or ".join(self._options.connect)
        while connector is not None and connector.link is None and not connector.opened:
            self._service.raise_failure()
            if connector.failure is Failure.UNRESOLVED and len(self._options.connect) == 1:
                raise UserError(f"cannot reach {where}: {Failure.UNRESOLVED}", LINK_FAILED)
            if monotonic() - self._begun_s >= timeout_s:
                why = connector.failure or Failure.SILENT
                if why is Failure.REFUSED and self._is_foreign():
                    why = Failure.FOREIGN
                raise UserError(f"cannot reach {where} within {timeout_s:g} s: {why}", LINK_FAILED)
            sleep(POLL_S / 5)

    def _is_foreign(self) -> bool:
        """Whether somebody listens at the one place to connect to, who refuses this protocol."""
        places = self._options.connect_endpoints
        found = (why_not_reached(place) for choices in places for place in choices)
        return len(places) == 1 and Failure.FOREIGN in found

    def _tell_of_others(self, role: Role) -> None:
        """Say once that somebody is there who is not the other end of this call."""
        if not self._told and (who := self._others(role)):
            self._told = True
            self._say(who)

    def _others(self, role: Role) -> str | None:
        """Who has answered instead of the other end.  role: of the other end."""
        presence = self._service.presence
        if presence is None or presence.role is Role.RELAY:
            return self._refusal()
        if presence.call != self._options.call:
            return f"somebody is there, but for call {presence.call!r}"
        if presence.role is not role:
            return f"another {presence.role.name.lower()} of the call is there"
        # What it says may have been lost until now.
        self._unread_s = self._unread_s or monotonic()
        if monotonic() - self._unread_s < UNREAD_S:
            return None
        return "the other end is there, but has another invitation, or only one end has one"

    def _refusal(self) -> str | None:
        """What it means that nobody answers an end with a certificate, not even the relay."""
        connector = self._service.connector
        places = [each for choices in self._options.connect_endpoints for each in choices]
        has_certificate = all(place.scheme in CERTIFIED_SCHEMES for place in places)
        if connector is None or connector.link is not None or not has_certificate:
            self._unanswered_s = None
            return None
        now_s = monotonic()
        self._unanswered_s = self._unanswered_s or (now_s if connector.opened else None)
        if self._unanswered_s is None or now_s - self._unanswered_s < UNREAD_S:
            return None
        return (
            "the relay refuses this certificate: it was revoked, or is for another call or for the"
            " other end of this one"
        )

    def _leave(self, farewell: bytes | None = None) -> None:
        self._closed = True
        for _ in range(FAREWELLS if farewell else 0):
            self._service.put_now(farewell or b"")
            sleep(FAREWELL_S)
        self._service.stop()
        self._carrier.close_all()
        atexit.unregister(self._leave)


def link_service(
    options: LinkOptions,
    delivery: Delivery,
    protection: PacketProtection,
    on_arrival: Callable[[Arrival], None] = lambda arrival: None,
) -> LinkService:
    places = options.connect_endpoints
    connector = Connector(places) if places and not options.listen else None
    return LinkService(delivery, protection, connector, on_arrival)
