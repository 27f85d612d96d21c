"""Runs one end of a link: a thread that carries payloads between connections and delivery."""

import _thread
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Lock, RLock
from time import monotonic

from protocol.errors import ProtocolError
from protocol.link.connection import (
    LISTENING,
    Answered,
    Carrier,
    Connector,
    Elsewhere,
    Event,
    Open,
    Opened,
    Received,
)
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.interface import Arrival, PacketProtection
from protocol.link.messages import (
    NO_SESSION,
    Hello,
    is_hello,
    is_message,
    parse_message,
    session_in_hello,
)

# How often timers are looked at, and whether the transport of a link is still there.
TICK_S, CHECK_S = 0.02, 0.2
# So many events are handled before what is due is looked for, which takes longer the more decoders
# there are.
EVENTS_AT_ONCE = 64
# After what silence an encoder's or an idle decoder's link is searched anew, and that of a decoder
# to which frames are coming.
PATIENCE_S, ACTIVE_PATIENCE_S = 5.0, 1.5
# The encoder's over QUIC, which does not tell that the other end was killed, where the round trip
# is known to be short.
QUIC_PATIENCE_S, SHORT_TRIP_S = 3.0, 0.3
# When a candidate greets: at once, again, and with a question for whoever is there.
GREETINGS_S, QUESTION_S = (0.0, 0.03, 0.6, 1.2), (0.3, 1.0)
# How often the same question goes over a link that has become silent, and after which share of the
# patience: not between two reports of a decoder that has everything.
ASK_S, QUESTION_SHARE = 1.0, 0.67
# Pages of relays of which it is remembered which decoder they are.
MAX_PAGES = 4096
# How long the end of the thread is waited for.
STOP_S = 1.0
# Memory of an event besides its payload, and the most that waits to be handled: more is dropped.
EVENT_OVERHEAD_BYTES, MAX_WAITING_BYTES = 256, 4 * 1024 * 1024

Delivery = DeliverySender | DeliveryReceiver


class LinkService:
    """One end of a link.

    connector: None: the end listens.
    on_arrival: called with each packet received, in the thread of the service.
    presence: who has answered last; None: nobody has.
    """

    def __init__(
        self,
        delivery: Delivery,
        protection: PacketProtection,
        connector: Connector | None,
        on_arrival: Callable[[Arrival], None] = lambda arrival: None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self.lock = RLock()
        self.delivery, self._protection, self.connector = delivery, protection, connector
        self._events: SimpleQueue[Event | None] = SimpleQueue()
        self._waiting_bytes, self._counting = 0, Lock()
        self.presence: Answered | None = None
        self._failure: Exception | None = None
        self._on_arrival, self._clock = on_arrival, clock
        self._carrier: Carrier | None = None
        self._checked_s = self._asked_s = float("-inf")
        self._heard_s = float("-inf")
        self._greetings: dict[int, list[tuple[float, bool]]] = {}
        self._pages: dict[bytes, str] = {}  # of relays, by the sessions of their decoders
        self._stopping = False
        self._stopped: SimpleQueue[None] = SimpleQueue()

    @property
    def is_linked(self) -> bool:
        """Whether there is a link; an end that listens always has one."""
        return self.connector is None or self.connector.link is not None

    def attach(self, carrier: Carrier) -> None:
        """Take the connections of this end; before that nothing is sent."""
        self._carrier = carrier

    def start(self, carrier: Carrier) -> None:
        """Run in a thread of its own until `stop`."""
        self.attach(carrier)
        _thread.start_new_thread(self.run, ())

    def stop(self) -> None:
        """End the thread; the connections stay open."""
        self._stopping = True
        self._events.put(None)
        if self._carrier is not None:
            with suppress(Empty):
                self._stopped.get(timeout=STOP_S)

    def post(self, event: Event) -> None:
        """Take an event, from any thread.

        What strangers may send without limit is dropped while `MAX_WAITING_BYTES` wait.
        """
        with self._counting:
            waiting_bytes = self._waiting_bytes + _cost(event)
            may_drop = isinstance(event, Received | Answered | Elsewhere)
            if may_drop and waiting_bytes > MAX_WAITING_BYTES:
                return
            self._waiting_bytes = waiting_bytes
        self._events.put(event)

    def flush(self) -> None:
        """Send what is due."""
        with self.lock:
            self._put(self.delivery.payloads(self._clock()))

    def put_now(self, payload: bytes) -> None:
        """Send a payload beside what is due."""
        with self.lock:
            self._put([payload])

    def raise_failure(self) -> None:
        """Raise what has ended the thread, if that was an error."""
        if self._failure is not None:
            raise self._failure

    def run(self) -> None:
        """Run until `stop`, or until something fails, see `raise_failure`."""
        try:
            while not self._stopping:
                self.step()
        except Exception as error:
            # For whoever uses this end: here nobody would see it.
            self._failure = error
        finally:
            self._stopped.put(None)

    def step(self) -> None:
        """Wait for an event, a moment at most, handle those that are there, and do what is due."""
        events = [self._next_event(TICK_S)]
        while events[-1] is not None and len(events) < EVENTS_AT_ONCE:
            events.append(self._next_event(0.0))
        with self.lock:
            for event in events:
                if event is not None:
                    self._handle(event)
            if not self._stopping:
                self._tick(self._clock())

    def _next_event(self, timeout_s: float) -> Event | None:
        with suppress(Empty):
            event = self._events.get(timeout=timeout_s)
            with self._counting:
                self._waiting_bytes -= _cost(event)
            return event
        return None

    def _handle(self, event: Event) -> None:
        now_s = self._clock()
        if isinstance(event, Received):
            self._receive(event)
        elif isinstance(event, Answered):
            self.presence = event
            self._heard(event.connection, now_s, is_proof=False)
        elif self.connector is not None:
            if isinstance(event, Opened):
                self.connector.on_opened(event.connection, now_s)
                due = [(now_s + wait_s, False) for wait_s in GREETINGS_S]
                due += [(now_s + wait_s, True) for wait_s in QUESTION_S]
                self._greetings[event.connection] = sorted(due)
            elif isinstance(event, Elsewhere):
                self.connector.on_elsewhere(event.host, event.port)
            else:
                self.connector.on_failed(event.connection, event.failure)

    def _receive(self, event: Received) -> None:
        data = self._protection.unprotect(event.data)
        if data is None:
            return
        try:
            arrivals = self.delivery.receive(data, event.time_s)
        except ProtocolError:
            return
        self._note_page(data, event.page)
        self._heard(event.connection, event.time_s, is_proof=True)
        for arrival in arrivals or ():
            self._on_arrival(arrival)

    def _note_page(self, data: bytes, page: str) -> None:
        """Remember which page a decoder is: what is said to it alone goes to that."""
        session = session_in_hello(data)
        if session is None or session == NO_SESSION:
            return
        self._pages.pop(session, None)
        if page:
            self._pages[session] = page
        if len(self._pages) > MAX_PAGES:
            del self._pages[next(iter(self._pages))]

    def _page(self, payload: bytes) -> str:
        """The page that a payload is for alone; "" if it is for all."""
        if not self._pages or not is_hello(payload):
            return ""
        hello = parse_message(payload)
        return self._pages.get(hello.echo, "") if isinstance(hello, Hello) else ""

    def _heard(self, connection: int, now_s: float, is_proof: bool) -> None:
        """is_proof: what has come is of this call."""
        self._heard_s = now_s
        if self.connector is not None:
            before = self.connector.link
            if is_proof:
                self.connector.on_heard(connection, now_s)
            else:
                self.connector.on_presence(connection, now_s)
            if self.connector.link != before:
                self.delivery.on_new_link()
            if isinstance(self.delivery, DeliveryReceiver) and self.connector.endpoint is not None:
                self.delivery.is_reliable = self.connector.endpoint.is_reliable

    def _tick(self, now_s: float) -> None:
        if isinstance(self.delivery, DeliveryReceiver):
            for arrival in self.delivery.due(now_s):
                self._on_arrival(arrival)
        if self.connector is not None:
            self._connect(self.connector, now_s)
        self._check(now_s)
        self._put(self.delivery.payloads(now_s))

    def _patience_s(self, now_s: float) -> float:
        if isinstance(self.delivery, DeliveryReceiver):
            return ACTIVE_PATIENCE_S if self.delivery.is_active(now_s) else PATIENCE_S
        endpoint = None if self.connector is None else self.connector.endpoint
        round_trip_s = self.delivery.quality.round_trip_s
        is_short = round_trip_s is not None and round_trip_s < SHORT_TRIP_S
        is_quic = endpoint is not None and endpoint.is_quic
        return QUIC_PATIENCE_S if is_quic and is_short else PATIENCE_S

    def _connect(self, connector: Connector, now_s: float) -> None:
        assert self._carrier is not None
        patience_s = self._patience_s(now_s)
        for action in connector.tick(now_s, patience_s):
            if isinstance(action, Open):
                self._carrier.open(action.connection, action.endpoint)
            else:
                self._greetings.pop(action.connection, None)
                self._carrier.close(action.connection)
        for connection in connector.opened:
            waiting = self._greetings.get(connection, [])
            while waiting and waiting[0][0] <= now_s:
                if waiting.pop(0)[1]:
                    self._carrier.ask(connection)
                else:
                    self._put_to(connection, self.delivery.hello(now_s))
        silent = now_s - self._heard_s > QUESTION_SHARE * patience_s
        if connector.link is not None and silent and now_s - self._asked_s > ASK_S:
            self._asked_s = now_s
            self._carrier.ask(connector.link)

    def _check(self, now_s: float) -> None:
        """Notice that the transport of the link has ended."""
        if now_s - self._checked_s < CHECK_S:
            return
        assert self._carrier is not None
        self._checked_s = now_s
        if self.connector is None:
            self._carrier.listen_again()
        link = LISTENING if self.connector is None else self.connector.link
        if link is None or self._carrier.is_linked(link):
            return
        if self.connector is not None:
            self.connector.on_broken(link)
        if isinstance(self.delivery, DeliverySender):
            self.delivery.forget_peers()

    def _put(self, payloads: list[bytes]) -> None:
        link = LISTENING if self.connector is None else self.connector.link
        if link is None or self._carrier is None:
            return
        for payload in payloads:
            self._put_to(link, payload)

    def _put_to(self, connection: int, payload: bytes) -> None:
        assert self._carrier is not None
        guarded = self._protection.protect(payload)
        kind = not is_message(payload), is_hello(payload)
        self._carrier.put(connection, guarded, *kind, self._page(payload))


def _cost(event: Event | None) -> int:
    """Memory that an event takes, bytes."""
    return EVENT_OVERHEAD_BYTES + (len(event.data) if isinstance(event, Received) else 0)
