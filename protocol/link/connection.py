"""The connections of an end: what happens to them, and which of them it tries, keeps and gives up.

There is no input and output here, and time is an argument.

While nothing is heard a new candidate is opened every now and then.  The first that hears anything
becomes the link and the others are closed; the link before is held until then.  On a lossy link
this repairs what the transport sends only once.
"""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from protocol.endpoint import CERTIFIED_SCHEMES, Endpoint
from protocol.link.endpoints import Failure
from protocol.link.messages import Role

_log = logging.getLogger(__name__)

# How often a candidate is opened, in the first seconds of silence and later.
EARLY_PAUSE_S, LATE_PAUSE_S, EARLY_S = 0.4, 1.0, 10.0
# After what silence every second candidate takes the other transport.
FALLBACK_S = 4.0
# A candidate that is open and hears nothing for so long is closed.
DEAF_S, RELIABLE_DEAF_S = 2.0, 8.0
# Places that others have told of; the newest are tried.
MAX_TOLD = 4
# The connection of an end that listens.
LISTENING = -1


@dataclass(frozen=True, slots=True)
class Open:
    """Open a connection."""

    connection: int
    endpoint: Endpoint


@dataclass(frozen=True, slots=True)
class Close:
    """Close a connection."""

    connection: int


Action = Open | Close


@dataclass(frozen=True, slots=True)
class Opened:
    """A connection is open."""

    connection: int


@dataclass(frozen=True, slots=True)
class Failed:
    """A connection could not be opened."""

    connection: int
    failure: Failure


@dataclass(frozen=True, slots=True)
class Received:
    """A payload has come.  page: of a relay, that it is from; "": from somebody else."""

    connection: int
    data: bytes
    time_s: float
    page: str = ""


@dataclass(frozen=True, slots=True)
class Answered:
    """Somebody has answered who is there; call: what that end is for, "" for a relay."""

    connection: int
    role: Role
    call: str


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Somebody on the local network says that the other end listens there now."""

    host: str
    port: int


Event = Opened | Failed | Received | Answered | Elsewhere


class Carrier(Protocol):
    """Connections that carry payloads; what happens to them comes as events."""

    def open(self, connection: int, endpoint: Endpoint) -> None:
        """Begin to open a connection; `Opened` or `Failed` follows."""

    def put(
        self, connection: int, payload: bytes, is_frame: bool, is_hello: bool, page: str = ""
    ) -> None:
        """Send a payload; nothing happens if the connection is gone.

        is_frame: it is a frame packet, and no message of the link.  is_hello: it is a HELLO, which
        may not reach an end of another call.  page: of a relay, which alone gets it; "": all do.
        """

    def ask(self, connection: int) -> None:
        """Ask who is there; `Answered` follows for each answer."""

    def is_linked(self, connection: int) -> bool:
        """Whether another host is connected."""

    def listen_again(self) -> None:
        """Listen where an address that was listened on has been replaced, in the background."""

    def close(self, connection: int) -> None:
        """Close a connection, in the background."""

    def close_all(self) -> None:
        """Close all connections and wait for it, in bounds."""


@dataclass(slots=True)
class _Candidate:
    endpoint: Endpoint
    is_told: bool
    opened_s: float | None = None

    @property
    def deaf_s(self) -> float:
        return RELIABLE_DEAF_S if self.endpoint.is_reliable else DEAF_S


class Connector:
    """The connections of one end to any of `places`, each with its endpoints, the best first.

    link: the connection in use; None: none has heard anything yet.
    failure: why the newest attempt failed; None: it did not.
    """

    def __init__(self, places: Sequence[Sequence[Endpoint]]) -> None:
        self._places = [tuple(place) for place in places]
        self._told: list[tuple[Endpoint, ...]] = []
        self._next: tuple[Endpoint, ...] | None = None  # a place that has just been told of
        self.link: int | None = None
        self.failure: Failure | None = None
        self._candidates: dict[int, _Candidate] = {}
        self._count = 0
        self._heard_s = float("-inf")
        self._begun_s: float | None = None  # when the search began
        self._opened_s = float("-inf")
        self._endpoint: Endpoint | None = None
        self._to_close: list[int] = []

    @property
    def endpoint(self) -> Endpoint | None:
        """Of the link."""
        return self._endpoint

    @property
    def opened(self) -> tuple[int, ...]:
        """The candidates that are open."""
        return tuple(
            number for number, each in self._candidates.items() if each.opened_s is not None
        )

    def on_opened(self, connection: int, now_s: float) -> None:
        """A candidate is open."""
        if candidate := self._candidates.get(connection):
            _log.info("connection %d to %s is open", connection, candidate.endpoint)
            candidate.opened_s, self.failure = now_s, None

    def on_failed(self, connection: int, failure: Failure) -> None:
        """A candidate could not be opened."""
        candidate = self._candidates.pop(connection, None)
        if candidate is not None:
            _log.info("connection %d to %s failed: %s", connection, candidate.endpoint, failure)
            self.failure = failure

    def on_heard(self, connection: int, now_s: float) -> None:
        """Something has come over a connection."""
        candidate = self._candidates.pop(connection, None)
        if candidate is not None:
            self._to_close += [*self._candidates, *([] if self.link is None else [self.link])]
            self._candidates.clear()
            _log.info("connection %d to %s is the link", connection, candidate.endpoint)
            self.link, self._endpoint = connection, candidate.endpoint
        if connection == self.link:
            self._heard_s, self._begun_s = now_s, None

    def on_presence(self, connection: int, now_s: float) -> None:
        """Somebody has answered who is there: no proof at a place that others have told of."""
        candidate = self._candidates.get(connection)
        if candidate is None or not candidate.is_told:
            self.on_heard(connection, now_s)

    def on_elsewhere(self, host: str, port: int) -> None:
        """The other end may listen there now; it is tried next, beside the link.

        Nothing happens where a certificate has to name the host.
        """
        place = tuple(
            replace(each, host=host, port=port)
            for each in self._places[0]
            if each.scheme not in CERTIFIED_SCHEMES
        )
        tried = {each.endpoint for each in self._candidates.values()} | {self._endpoint}
        if not place or not tried.isdisjoint(place):
            return
        self._told = [*(each for each in self._told if each != place), place][-MAX_TOLD:]
        self._next, self._heard_s = place, float("-inf")

    def on_broken(self, connection: int) -> None:
        """The transport of a connection has ended."""
        if connection == self.link:
            _log.info("the link, connection %d, has broken", connection)
            self.link, self._heard_s = None, float("-inf")
            self._to_close.append(connection)

    def tick(self, now_s: float, patience_s: float) -> list[Action]:
        """What is to be done now.  patience_s: silence after which the link counts as deaf."""
        for number, each in list(self._candidates.items()):
            if each.opened_s is not None and now_s - each.opened_s > each.deaf_s:
                del self._candidates[number]
                self._to_close.append(number)
        actions: list[Action] = [Close(number) for number in self._to_close]
        self._to_close.clear()
        if now_s - self._heard_s > patience_s:
            actions += self._search(now_s)
        return actions

    def _search(self, now_s: float) -> Iterator[Action]:
        begun_s = self._begun_s = now_s if self._begun_s is None else self._begun_s
        pause_s = EARLY_PAUSE_S if now_s - begun_s < EARLY_S else LATE_PAUSE_S
        if now_s - self._opened_s < pause_s:
            return
        self._opened_s, number = now_s, self._count
        self._count += 1
        places = [*self._told, *self._places]
        place = self._next or places[number % len(places)]
        self._next = None
        turn = number // len(places) if now_s - begun_s >= FALLBACK_S else 0
        endpoint = place[turn % len(place)]
        # One that repeats its set-up by itself needs no second one.
        if endpoint.is_reliable and any(
            each.endpoint == endpoint for each in self._candidates.values()
        ):
            return
        self._candidates[number] = _Candidate(endpoint, place in self._told)
        yield Open(number, endpoint)
