"""Calls on the local network: who listens answers who asks, over multicast.

A question is the magic `RZQ1`, a number of eight random bytes, and zeros up to `QUESTION_BYTES`:
no answer is longer, so nobody is made to send more than was asked for.  An answer goes to the asker
alone: the magic `RZA1`, the number, flags (bit 0: an encoder listens, bit 1: an invitation is
needed), the port (2 bytes, the highest first), and the call's name.  An answer with the number 0
goes to all: whose address has changed says so without being asked.
"""

import secrets
import socket
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Self

from protocol.endpoint import OwnAddress
from protocol.errors import ProtocolError
from protocol.limits import CALL_NAME

# Of the addresses for use within one organisation (RFC 2365).
GROUP, PORT = "239.255.116.34", 7448
QUESTION_BYTES = 128
# Questions that are answered at once, and then a second: a flood of them gets no more.
ANSWERS_PER_S = 20.0
# Datagrams get lost: a question is asked this often.
ASK_S = 0.5
_QUESTION, _ANSWER = b"RZQ1", b"RZA1"
_NUMBER_BYTES = 8
# Of an answer to all.
TO_ALL = bytes(_NUMBER_BYTES)
# How often an end that listens looks whether its address has changed, for how long after that it
# says so, and how often: others may be cut off for a while.
LOOK_S, NOTICES_S, NOTICE_S = 0.25, 120.0, 1.0
_ENCODER, _INVITED = 1, 2
# A local network: no router passes on what is asked.
_HOPS = 1


@dataclass(frozen=True, slots=True, order=True)
class FoundCall:
    """A call for which somebody listens.

    is_encoder: an encoder listens, for decoders; else a decoder, for an encoder.
    needs_invitation: without it nobody can take part.
    """

    call: str
    host: str
    port: int
    is_encoder: bool
    needs_invitation: bool

    @property
    def address(self) -> str:
        """HOST:PORT."""
        return f"{self.host}:{self.port}"


class _GroupThread(ABC):
    """Receives what is sent to the group, in a thread of its own, until it is closed.

    address: of the network interface; None: that of the default route.
    Where there is no multicast nothing comes.
    """

    def __init__(self, address: str | None) -> None:
        self._socket = _group_socket(address)
        if self._socket is not None:
            threading.Thread(
                target=self._run_until_closed, args=(self._socket,), daemon=True
            ).start()

    def close(self) -> None:
        """Receive no more; closing twice has no further effect."""
        group, self._socket = self._socket, None
        if group is not None:
            with suppress(OSError):
                # Wakes the thread.
                group.shutdown(socket.SHUT_RD)
            group.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _run_until_closed(self, group: socket.socket) -> None:
        # A socket that has been closed raises.
        with suppress(OSError):
            self._run(group)

    @abstractmethod
    def _run(self, group: socket.socket) -> None:
        """Receive; raises `OSError` when the socket has been closed."""


class CallAnnouncer(_GroupThread):
    """Answers questions about one call, in a thread, until it is closed; says to all when the
    address of this host has changed.

    found: the call; its host stands in no answer: the asker sees who sent it.
    address: of the network interface; None: that of the default route.
    own: the address that others see; None: that where `found` can be reached, from all addresses.
    Where there is no multicast nobody asks, and nothing is answered.
    """

    def __init__(
        self, found: FoundCall, address: str | None = None, own: OwnAddress | None = None
    ) -> None:
        self._found = found
        self._own = own or OwnAddress(address or "0.0.0.0")
        self._known, self._changed_s = self._own.now, float("-inf")
        self._said_s = self._looked_s = float("-inf")
        self._allowed, self._filled_s = ANSWERS_PER_S, monotonic()
        super().__init__(address)

    def _run(self, group: socket.socket) -> None:
        group.settimeout(LOOK_S)
        while True:
            with suppress(TimeoutError):
                data, sender = group.recvfrom(2 * QUESTION_BYTES)
                number = parse_question(data)
                if number is not None and self._may_answer(monotonic()):
                    with suppress(OSError):
                        group.sendto(serialise_answer(number, self._found), sender)
            self._look(group, monotonic())

    def _look(self, group: socket.socket, now_s: float) -> None:
        """Say to all that the address of this host has changed, for a while."""
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s, address = now_s, self._own.now
            if address is not None and address != self._known:
                self._known, self._changed_s, self._said_s = address, now_s, float("-inf")
                _join_group(group, address)
        due = now_s - self._said_s >= NOTICE_S and now_s - self._changed_s < NOTICES_S
        if due and self._known is not None:
            self._said_s = now_s
            with suppress(OSError):
                _send_to_group_through(group, self._known)
                group.sendto(serialise_answer(TO_ALL, self._found), (GROUP, PORT))

    def _may_answer(self, now_s: float) -> bool:
        self._allowed += (now_s - self._filled_s) * ANSWERS_PER_S
        self._allowed, self._filled_s = min(self._allowed, ANSWERS_PER_S), now_s
        if self._allowed < 1:
            return False
        self._allowed -= 1
        return True


class CallWatch(_GroupThread):
    """Notices, until closed, at which places the other end of a call announces that it listens.

    is_encoder: whether the other end is the call's encoder.
    on_notice: called in a thread of its own.
    address: of the network interface; None: that of the default route.
    """

    def __init__(
        self,
        call: str,
        is_encoder: bool,
        on_notice: Callable[[FoundCall], None],
        address: str | None = None,
    ) -> None:
        self._call, self._is_encoder, self._on_notice = call, is_encoder, on_notice
        super().__init__(address)

    def _run(self, group: socket.socket) -> None:
        while True:
            data, sender = group.recvfrom(2 * QUESTION_BYTES)
            with suppress(ProtocolError):
                # A closed socket gives nothing from nobody.
                found = parse_answer(data, TO_ALL, sender[0] if sender else "")
                if (found.call, found.is_encoder) == (self._call, self._is_encoder):
                    self._on_notice(found)


def find_calls(wait_s: float, address: str | None = None) -> Iterator[FoundCall]:
    """Each call on the local network as soon as it has answered, for `wait_s` seconds.

    address: of the network interface; None: that of the default route.
    """
    number, seen = secrets.token_bytes(_NUMBER_BYTES), set[FoundCall]()
    deadline = monotonic() + wait_s
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        _send_to_group_through(asking, address)
        asked_s = float("-inf")
        while (now := monotonic()) < deadline:
            if now >= asked_s + ASK_S:
                # Without a network nobody answers, which is what is reported.
                with suppress(OSError):
                    asking.sendto(serialise_question(number), (GROUP, PORT))
                asked_s = now
            asking.settimeout(max(0.001, min(deadline, asked_s + ASK_S) - now))
            with suppress(OSError, ProtocolError):
                data, (host, _) = asking.recvfrom(2 * QUESTION_BYTES)
                found = parse_answer(data, number, host)
                if found not in seen:
                    seen.add(found)
                    yield found


def serialise_question(number: bytes) -> bytes:
    """A question with a number of eight bytes."""
    return (_QUESTION + number).ljust(QUESTION_BYTES, b"\0")


def parse_question(data: bytes) -> bytes | None:
    """The number of a question; None if `data` is none."""
    number = data[len(_QUESTION) : len(_QUESTION) + _NUMBER_BYTES]
    return number if data == serialise_question(number) else None


def serialise_answer(number: bytes, found: FoundCall) -> bytes:
    """The answer to the question of a number."""
    flags = found.is_encoder * _ENCODER | found.needs_invitation * _INVITED
    return _ANSWER + number + struct.pack(">BH", flags, found.port) + found.call.encode("ascii")


def parse_answer(data: bytes, number: bytes, host: str) -> FoundCall:
    """The call in an answer that came from `host`.  Raises `ProtocolError` if it is none to us."""
    head = len(_ANSWER) + _NUMBER_BYTES
    if data[:head] != _ANSWER + number or not head + 3 < len(data) <= QUESTION_BYTES:
        raise ProtocolError("no answer to this question")
    flags, port = struct.unpack_from(">BH", data, head)
    name = data[head + 3 :].decode("ascii", "replace")
    if flags > 3 or not port or not CALL_NAME.fullmatch(name):
        raise ProtocolError("an answer that names no call")
    return FoundCall(name, host, port, bool(flags & _ENCODER), bool(flags & _INVITED))


def _group_socket(address: str | None) -> socket.socket | None:
    """A socket that receives questions; None where there is no multicast."""
    group = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        # Several calls may be waited for on one host.
        group.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        group.bind((GROUP, PORT))
        group.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, _membership(address))
    except OSError:
        group.close()
        return None
    return group


def _join_group(group: socket.socket, address: str) -> None:
    """Receive questions at another interface, too; one that has been joined already stays."""
    with suppress(OSError):
        group.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, _membership(address))


def _membership(address: str | None) -> bytes:
    return socket.inet_aton(GROUP) + socket.inet_aton(address or "0.0.0.0")


def _send_to_group_through(asking: socket.socket, address: str | None) -> None:
    asking.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, _HOPS)
    interface = socket.inet_aton(address or "0.0.0.0")
    asking.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
