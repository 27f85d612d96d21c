"""A call over a serial line: a cable, a radio modem, anything that carries bytes both ways.

The payloads go one after the other, each ended by a zero byte, and have none of their own: by
consistent overhead byte stuffing (Cheshire and Baker 1997) one takes a byte more for each 254.  A
byte that is lost or changed costs the payload that it is in; the next zero begins another.
"""

import queue
import threading
from contextlib import suppress
from time import monotonic

import serial

from protocol.endpoint import Endpoint
from protocol.link.connection import LISTENING, Failed, Opened, Received
from protocol.link.endpoints import Failure
from protocol.link.link_service import LinkService
from shared_model.errors import LINK_FAILED, UserError

# Payloads that wait for a line that is slower; what comes then is lost, as on a network.
MAX_WAITING = 64
# A payload that is longer is noise without a zero in it.
MAX_PAYLOAD_BYTES = 1 << 16
READ_S, CLOSING_S = 0.1, 1.0
DEFAULT_BAUD = 115200


class SerialCarrier:
    """The line of one end: a `Carrier`.  Raises `UserError` if an end that listens has none.

    is_listening: the line is there from the beginning.
    """

    def __init__(self, endpoint: Endpoint, is_listening: bool, service: LinkService) -> None:
        self._device, self._baud = endpoint.host, baud_of(endpoint)
        self._post = service.post
        self._line: serial.Serial | None = None
        self._connection = LISTENING  # the newest, which what comes is of
        self._waiting: queue.Queue[bytes | None] = queue.Queue(MAX_WAITING)
        self._threads: list[threading.Thread] = []
        if is_listening:
            try:
                self._begin()
            except (OSError, ValueError) as error:
                where = f"cannot listen on {self._device}"
                raise UserError(f"{where}: {reason(error)}", LINK_FAILED) from error

    def open(self, connection: int, endpoint: Endpoint) -> None:
        """See `Carrier`."""
        self._connection = connection
        try:
            if self._line is None:
                self._begin()
        except (OSError, ValueError):
            self._post(Failed(connection, Failure.UNREACHABLE))
        else:
            self._post(Opened(connection))

    def put(
        self, connection: int, payload: bytes, is_frame: bool, is_hello: bool, page: str = ""
    ) -> None:
        """See `Carrier`."""
        if self._line is not None:
            with suppress(queue.Full):
                self._waiting.put_nowait(stuffed(payload))

    def ask(self, connection: int) -> None:
        """See `Carrier`; on a line there is nobody else who could answer."""

    def is_linked(self, connection: int) -> bool:
        """See `Carrier`."""
        return self._line is not None

    def listen_again(self) -> None:
        """See `Carrier`; a line has no address."""

    def close(self, connection: int) -> None:
        """See `Carrier`; the line stays for the connections to come."""

    def close_all(self) -> None:
        """See `Carrier`."""
        line, self._line = self._line, None
        if line is None:
            return
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        for thread in self._threads:
            thread.join(CLOSING_S)
        line.close()

    def _begin(self) -> None:
        self._line = line = serial.serial_for_url(self._device, self._baud, timeout=READ_S)
        self._threads = [
            threading.Thread(target=work, args=(line,), daemon=True)
            for work in (self._read, self._write)
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, line: serial.Serial) -> None:
        unfinished = b""
        with suppress(OSError):
            while self._line is line:
                *whole, unfinished = (unfinished + line.read(max(1, line.in_waiting))).split(b"\0")
                unfinished = unfinished[-MAX_PAYLOAD_BYTES:]
                for each in whole:
                    payload = unstuffed(each)
                    if payload:
                        self._post(Received(self._connection, payload, monotonic()))
        self._lose(line)

    def _write(self, line: serial.Serial) -> None:
        with suppress(OSError):
            while (data := self._waiting.get()) is not None:
                line.write(data)
        self._lose(line)

    def _lose(self, line: serial.Serial) -> None:
        """The line has ended: it was pulled out."""
        if self._line is line:
            self._line = None


def baud_of(endpoint: Endpoint) -> int:
    """The bits per second of a line.  Raises `UserError` if its option is another one."""
    name, _, value = endpoint.options.removeprefix("?").partition("=")
    if name not in ("", "baud"):
        raise UserError(f"endpoint serial/{endpoint.host}{endpoint.options}: expected ?baud=RATE")
    return int(value or DEFAULT_BAUD)


def stuffed(payload: bytes) -> bytes:
    """A payload as it goes over the line, with the zeros around it."""
    sent = bytearray(b"\0")
    for piece in (payload + b"\0").split(b"\0")[:-1]:
        while len(piece) >= 254:
            sent += b"\xff" + piece[:254]
            piece = piece[254:]
        sent += bytes([len(piece) + 1]) + piece
    return bytes(sent) + b"\0"


def unstuffed(data: bytes) -> bytes | None:
    """The payload of what has come between two zeros; None: it is damaged."""
    payload, place = bytearray(), 0
    while place < len(data):
        length = data[place]
        piece = data[place + 1 : place + length]
        if len(piece) < length - 1:
            return None
        payload += piece
        place += length
        if length < 255 and place < len(data):
            payload.append(0)
    return bytes(payload)


def reason(error: Exception) -> str:
    """Why a line cannot be had, without the library's words around it."""
    return str(getattr(error, "strerror", None) or error)
