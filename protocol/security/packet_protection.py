"""SFrame on a link: which packets are of this call, and of this time.

Each end sends under two keys.  The key of HELLO messages follows from the invitation alone, so
whoever has the invitation can read them; a HELLO names the session of its sender, a random number
drawn at each start.  The key of all other packets follows from that number as well.  A session
counts once its HELLO has echoed the receiver's own session: what was recorded of an earlier call,
or of this one before a restart, is under keys that nobody takes any more.

The counters of a sender go through all its packets.  That of a HELLO (0, 1, 2 ...) stands within,
before the message; its SFrame counter is that number added to the session, for all senders of HELLO
messages share a key.  No counter goes out twice: what is repeated is protected again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from threading import Lock

from protocol.errors import ProtocolError
from protocol.limits import SESSION_BYTES
from protocol.security.sframe import (
    COUNTER_LIMIT,
    Key,
    ReplayWindow,
    derive_base_key,
    derive_key,
    derive_session_key,
    parse_header,
    protect,
    random_session,
    unprotect,
)

HELLO_KEY_ID = 0
# The counter within a HELLO.
POSITION_BYTES = 4
# Sessions that a receiver knows at most.
MAX_PEERS = 64
# A packet that cannot be read and has a counter this close to that of a session that can was
# changed, or somebody forges; that many others may be of a session that is yet to introduce itself.
NEAR_COUNTERS = 64
MAX_UNREADABLE = 64

SessionInHello = Callable[[bytes], bytes | None]


class Sender(StrEnum):
    """The two ends of a call, as their keys are derived."""

    ENCODER = "encoder"
    DECODER = "decoder"

    @property
    def other(self) -> "Sender":
        """The end that this one talks to."""
        return Sender.DECODER if self is Sender.ENCODER else Sender.ENCODER


@dataclass(frozen=True, slots=True)
class _Peer:
    key: Key
    window: ReplayWindow


class SFrameProtection:
    """Protects what one end of a call sends, and takes what the other end has protected.

    Any thread may call it.  It is a `PacketProtection` of the link.
    """

    def __init__(
        self,
        key: bytes,
        call: str,
        sender: Sender,
        session_in_hello: SessionInHello,
        on_stranger: Callable[[], None],
    ) -> None:
        """key: of the invitation.  call: the call's name.  sender: which end this is.

        session_in_hello: the session that a message of the link names if it is a HELLO, else None.
        on_stranger: called once, when packets come that are not of this call or were changed.
        """
        self._sender, self._session_in_hello = sender, session_in_hello
        self._on_stranger: Callable[[], None] | None = on_stranger
        self._number = random_session()
        self._sent_base = derive_base_key(key, sender, call)
        self._received_base = derive_base_key(key, sender.other, call)
        self._sent_key = derive_session_key(self._sent_base, self._number)
        self._sent_hello_key = derive_key(self._sent_base, HELLO_KEY_ID)
        self._received_hello_key = derive_key(self._received_base, HELLO_KEY_ID)
        self._counter, self._unreadable = 0, 0
        # Sessions whose HELLO has come, with its counter; those that have echoed ours, newest last.
        self._heard: dict[bytes, int] = {}
        self._peers: dict[bytes, _Peer] = {}
        self._lock = Lock()

    @property
    def session(self) -> bytes:
        """The number of this start, `SESSION_BYTES` bytes."""
        return self._number.to_bytes(SESSION_BYTES, "big")

    def protect(self, data: bytes) -> bytes:
        """The packet to send for a message or a packet of the call."""
        with self._lock:
            counter, metadata = self._counter, self._sent_metadata
            self._counter += 1
        if self._session_in_hello(data) is None:
            return protect(self._sent_key, counter, data, metadata)
        message = counter.to_bytes(POSITION_BYTES, "big") + data
        return protect(self._sent_hello_key, (self._number + counter) % COUNTER_LIMIT, message)

    def unprotect(self, data: bytes) -> bytes | None:
        """What was protected; None if it is not of this call, was changed, or came before."""
        try:
            key_id, counter, _ = parse_header(data)
        except ProtocolError:
            self._note_stranger()
            return None
        with self._lock:
            if key_id == HELLO_KEY_ID:
                plaintext, is_strange = self._hello(data)
            else:
                plaintext, is_strange = self._packet(data, key_id, counter)
        if is_strange:
            self._note_stranger()
        return plaintext

    def on_peer(self, session: bytes) -> None:
        """Take the packets of a session, whose HELLO has come and has echoed ours.

        Beyond `MAX_PEERS` sessions the one that was added first is given up.
        """
        with self._lock:
            if session in self._peers or session not in self._heard:
                return
            number = int.from_bytes(session, "big")
            # What was sent before the HELLO may be a recording.
            window = ReplayWindow(self._heard.pop(session))
            self._peers[session] = _Peer(derive_session_key(self._received_base, number), window)
            if len(self._peers) > MAX_PEERS:
                del self._peers[next(iter(self._peers))]

    @property
    def _sent_metadata(self) -> bytes:
        """Ties what a decoder sends to one start of the encoder."""
        if self._sender is Sender.ENCODER or not self._peers:
            return b""
        return next(reversed(self._peers))

    @property
    def _received_metadata(self) -> bytes:
        return self.session if self._sender is Sender.ENCODER else b""

    def _hello(self, data: bytes) -> tuple[bytes | None, bool]:
        """The HELLO in a packet, and whether a stranger sent it."""
        try:
            _, plaintext = unprotect(self._received_hello_key, data)
        except ProtocolError:
            return None, True
        position = int.from_bytes(plaintext[:POSITION_BYTES], "big")
        message = plaintext[POSITION_BYTES:]
        session = self._session_in_hello(message)
        if session is None:
            return None, True
        if session in self._peers:
            return (message if self._peers[session].window.take(position) else None), False
        self._heard.pop(session, None)
        self._heard[session] = position
        if len(self._heard) > MAX_PEERS:
            del self._heard[next(iter(self._heard))]
        return message, False

    def _packet(self, data: bytes, key_id: int, counter: int) -> tuple[bytes | None, bool]:
        """What a packet of a session says, and whether a stranger sent it."""
        is_near = False
        for peer in reversed(self._peers.values()):
            # Garbage is cheap: it seldom has a key ID and a counter that can be.
            if peer.key.key_id != key_id or not peer.window.can_take(counter):
                continue
            try:
                _, plaintext = unprotect(peer.key, data, self._received_metadata)
            except ProtocolError:
                is_near |= abs(counter - peer.window.newest) < NEAR_COUNTERS
                continue
            peer.window.take(counter)
            return plaintext, False
        self._unreadable += 1
        is_open = self._session_in_hello(data) is not None
        return None, is_near or is_open or self._unreadable > MAX_UNREADABLE

    def _note_stranger(self) -> None:
        with self._lock:
            tell, self._on_stranger = self._on_stranger, None
        if tell is not None:
            tell()
