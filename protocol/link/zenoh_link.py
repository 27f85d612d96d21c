"""A call over Zenoh.

The encoder publishes on d/CALL, the decoders on u/CALL, see `protocol.link.presence`; straight to
the other end all but HELLO messages on d and u.  Who connects also subscribes to the
other's key, and repairs its session by opening another one: nothing else has to be declared.
On the key w an end asks who is there; the answers come on the key that it subscribes to, marked
by an attachment.  Zenoh's multicast discovery is off: one end listens and the other connects to it,
or both connect to a router; `protocol.discovery` tells where an end listens that has moved.
"""

from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from typing import Any

import zenoh
from zenoh import CongestionControl
from zenoh.handlers import Callback

from protocol.discovery import CallWatch
from protocol.endpoint import Endpoint
from protocol.link.connection import LISTENING, Answered, Elsewhere, Failed, Opened, Received
from protocol.link.endpoints import (
    Failure,
    ListenedPlaces,
    addresses_of,
    check_listening,
    resolve,
    source_address,
)
from protocol.link.interface import (
    LinkOptions,
    MessageCallback,
)
from protocol.link.link_service import LinkService
from protocol.link.messages import Role
from protocol.link.presence import (
    WHO_KEY,
    call_keys,
    page_key,
    page_of,
    parse_presence,
    serialise_presence,
    short_key,
)
from protocol.link.zenoh_session import (
    SessionThreads,
    answer_who_is_there,
    open_session,
    reason,
    zenoh_config,
)
from protocol.link.zenoh_settings import (
    OPEN_S,
    client_settings,
    listener_settings,
    security_settings,
)
from protocol.security.link_security import LinkSecurity
from shared_model.errors import LINK_FAILED, UserError

# Failures within this time are refusals.
REFUSAL_S = 0.8 * OPEN_S
# Time that an end waits for sessions that are being opened or closed when it leaves.
CLOSING_S = 1.0


class ZenohCarrier:
    """The sessions of one end: a `Carrier`.  Callbacks run in Zenoh's receiving threads.

    Raises `UserError` if the end cannot listen.
    """

    def __init__(
        self, options: LinkOptions, role: Role, say: MessageCallback, service: LinkService
    ) -> None:
        self._call, self._role, self._post = options.call, role, service.post
        self._options, self._security, self._say = options, options.security, say
        is_encoder = role is Role.ENCODER
        self._sent_key, self._heard_key = call_keys(options.call, is_encoder)
        self._sessions: dict[int, zenoh.Session] = {}
        self._direct: set[int] = set()  # connections to an end, and not to a relay
        # Where connections lead to, and this host's address on the way when they were opened.
        self._ways: dict[int, tuple[Endpoint, str | None]] = {}
        self._opening: set[int] = set()  # connections that are wanted and not open
        # Links to a name, and those whose name has lost the address that they lead to.
        self._names: dict[int, Endpoint] = {}
        self._outdated: set[int] = set()
        self._background = SessionThreads()
        self._listened = ListenedPlaces(options.listen)
        self._is_moving = False  # a session that listens elsewhere is being opened
        if options.listen:
            self._take_listening(_listen(options))
        self._watch = _watch(options, role, self._post)

    def open(self, connection: int, endpoint: Endpoint) -> None:
        """See `Carrier`."""
        self._opening.add(connection)
        self._background.run(lambda: self._open(connection, endpoint))

    def put(
        self, connection: int, payload: bytes, is_frame: bool, is_hello: bool, page: str = ""
    ) -> None:
        """See `Carrier`."""
        if session := self._sessions.get(connection):
            is_short = connection in self._direct and not is_hello
            key = page_key(self._sent_key, page) if page else self._sent_key
            with suppress(zenoh.ZError):
                session.put(
                    short_key(self._sent_key) if is_short else key,
                    payload,
                    congestion_control=CongestionControl.DROP,
                    # Express packets skip batching, which would join pieces to fragments of IP; the
                    # flag takes two bytes, and an idle link sends at once without it.
                    express=not is_frame,
                )

    def ask(self, connection: int) -> None:
        """See `Carrier`."""
        if session := self._sessions.get(connection):
            with suppress(zenoh.ZError):
                session.put(WHO_KEY, serialise_presence(self._role, self._call))
        if (endpoint := self._names.get(connection)) and (way := self._ways.get(connection)):
            self._background.run(lambda: self._look_up(connection, endpoint, way[0]))

    def is_linked(self, connection: int) -> bool:
        """See `Carrier`."""
        session = self._sessions.get(connection)
        if session is None or session.is_closed() or self._has_moved(connection):
            return False
        if connection in self._outdated:
            return False
        return bool(session.info.transports())

    def listen_again(self) -> None:
        """See `Carrier`."""
        if not self._is_moving and self._listened.have_moved:
            self._is_moving = True
            self._background.run(self._listen_again)

    def close(self, connection: int) -> None:
        """See `Carrier`."""
        self._opening.discard(connection)
        self._direct.discard(connection)
        self._ways.pop(connection, None)
        self._names.pop(connection, None)
        self._outdated.discard(connection)
        session = self._sessions.pop(connection, None)
        if session is not None:
            self._background.run(session.close)
            del session

    def close_all(self) -> None:
        """See `Carrier`."""
        self._opening.clear()
        if self._watch is not None:
            self._watch.close()
        for connection in list(self._sessions):
            self.close(connection)
        self._background.wait(CLOSING_S)

    def _take_listening(self, session: zenoh.Session) -> None:
        self._sessions[LISTENING] = session
        self._subscribe(LISTENING, session)
        answer_who_is_there(session, self._role, self._call)

    def _listen_again(self) -> None:
        try:
            locators = self._listened.take_over()
            config = _config(listener_settings(self._options, locators), self._security)
            before, session = self._sessions.get(LISTENING), zenoh.open(config)
            if before is None:
                session.close()  # type: ignore[no-untyped-call]
                return
            self._take_listening(session)
            self._say(f"this host has another address: listening on {' and '.join(locators)}")
            before.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError:
            self._listened.forget()
        finally:
            self._is_moving = False

    def _open(self, connection: int, endpoint: Endpoint) -> None:
        begun_s = monotonic()
        try:
            resolved = resolve(endpoint, connection)
            if isinstance(resolved, Failure):
                self._post(Failed(connection, resolved))
                return
            self._ways[connection] = resolved, source_address(resolved)
            if resolved != endpoint:
                self._names[connection] = endpoint
            self._take(connection, zenoh.open(_config(client_settings(resolved), self._security)))
        except zenoh.ZError:
            self._ways.pop(connection, None)
            took_s = monotonic() - begun_s
            failure = Failure.REFUSED if took_s < REFUSAL_S else Failure.SILENT
            self._post(Failed(connection, failure))
        except BaseException:
            # Whatever it was: without an answer the connection would be waited for.
            self._post(Failed(connection, Failure.UNREACHABLE))
            raise

    def _look_up(self, connection: int, endpoint: Endpoint, resolved: Endpoint) -> None:
        """Notice that the name of a silent link has another address now."""
        if resolved.host not in (addresses_of(endpoint) or {resolved.host}):
            self._outdated.add(connection)

    def _has_moved(self, connection: int) -> bool:
        """Whether this host has got another address: nothing comes to the one before."""
        endpoint, before = self._ways.get(connection, (None, None))
        now = None if endpoint is None or before is None else source_address(endpoint)
        return now is not None and now != before

    def _take(self, connection: int, session: zenoh.Session) -> None:
        """Use a session that has been opened, unless it is not wanted any more."""
        if session.info.peers_zid():
            self._direct.add(connection)
        self._subscribe(connection, session)
        self._sessions[connection] = session
        if connection in self._opening:
            self._opening.discard(connection)
            self._post(Opened(connection))
        elif self._sessions.pop(connection, None) is not None:
            session.close()  # type: ignore[no-untyped-call]

    def _subscribe(self, connection: int, session: zenoh.Session) -> None:
        def arrived(sample: zenoh.Sample) -> None:
            data = sample.payload.to_bytes()
            if sample.attachment is None:
                self._post(Received(connection, data, monotonic(), page_of(str(sample.key_expr))))
            elif (found := parse_presence(data)) is not None:
                self._post(Answered(connection, *found))

        # With a thread of its own a callback would outlive an interrupted program.
        keys = [self._heard_key] + [short_key(self._heard_key)] * (connection == LISTENING)
        if self._role is Role.ENCODER and connection not in {LISTENING, *self._direct}:
            keys.append(page_key(self._heard_key, "*"))
        for key in keys:
            session.declare_subscriber(key, Callback(arrived, indirect=False))


def _watch(options: LinkOptions, role: Role, post: Callable[[Elsewhere], None]) -> CallWatch | None:
    """A watch for a new address of the other end on the local network; None: there is none."""
    places = [endpoints[0] for endpoints in options.connect_endpoints]
    if not places or not options.security.follows or all(each.is_loopback for each in places):
        return None
    return CallWatch(
        options.call,
        is_encoder=role is Role.DECODER,
        on_notice=lambda found: post(Elsewhere(found.host, found.port)),
    )


def _listen(options: LinkOptions) -> zenoh.Session:
    try:
        settings = listener_settings(options, options.listen_locators)
        return open_session(_config(settings, options.security))
    except zenoh.ZError as error:
        check_listening(options.listen)
        where = " and ".join(options.listen)
        raise UserError(f"cannot listen on {where}: {reason(error)}", LINK_FAILED) from error


def _config(settings: dict[str, Any], security: LinkSecurity) -> zenoh.Config:
    return zenoh_config(settings | security_settings(security))
