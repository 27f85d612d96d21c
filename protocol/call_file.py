"""Call files (.rzo): the magic `RZO1`, then records of a packet's length (varint) and the packet.

A complete call ends with an END control packet.  A file without one is truncated, for example by an
interrupted encoder; its records up to there are valid.
"""

from collections.abc import Iterator
from os import fstat
from pathlib import Path
from typing import BinaryIO, Self

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import MAX_MODEL_PACKET_BYTES
from protocol.link.interface import Reachability
from protocol.packets import is_end, max_packet_bytes, packet_kind
from shared_model.errors import UserError, cannot_read, cannot_write

MAGIC = b"RZO1"
MAX_LENGTH_BYTES = 3


class TruncatedCall(ProtocolError):
    """The file ends within a record; all packets before it are valid."""

    def __init__(self, offset: int, reason: str) -> None:
        super().__init__(f"the call is cut off: byte {offset}: {reason}")


def serialise_record(packet: bytes) -> bytes:
    """The record of a packet: length and packet."""
    return encode_varint(len(packet)) + packet


def read_records(file: BinaryIO) -> Iterator[bytes]:
    """The packets of a call file up to the END packet, read one by one.

    Raises `ProtocolError` if `file` is not a call file or a length is out of bounds, and
    `TruncatedCall` if it ends within a record.
    """
    head = file.read(len(MAGIC))
    if head != MAGIC:
        raise ProtocolError(f"no call file: it does not begin with {MAGIC.decode()}")
    packet, offset = b"", len(MAGIC)
    while not is_end(packet) and (length := _read_length(file, offset)) is not None:
        packet = file.read(length)
        if len(packet) < length:
            raise TruncatedCall(offset, f"packet has {len(packet)} bytes of {length}")
        if length > max_packet_bytes(packet_kind(packet)):
            raise ProtocolError(f"byte {offset}: packet of {length} bytes is too long for its kind")
        offset += len(encode_varint(length)) + length
        yield packet


class CallWriter:
    """Writes a call file: a `PacketSink`.

    The file is written under a temporary name next to `path` and renamed on closing, so `path`
    never ends within a record.  Leaving the `with` block by an exception closes the file as well
    and keeps the packets sent so far; without any packet no file is left.  After a failed write
    nothing more can be sent: the temporary file remains if it has a packet, and `path` is
    unchanged.
    """

    def __init__(self, path: Path) -> None:
        self._path = Path(path)
        self._part = self._path.with_name(self._path.name + ".part")
        self._empty, self._write_failed = True, False
        try:
            # Unbuffered: if the process is killed, the temporary file has all packets sent.
            self._file = open(self._part, "wb", buffering=0)  # noqa: SIM115 - kept open
        except OSError as error:
            raise cannot_write(self._path, error) from error
        try:
            self._write(MAGIC)
        except UserError:
            self.close()
            raise

    @property
    def reachability(self) -> Reachability:
        """A file always takes the packet."""
        return Reachability.HAS_PEER

    def send(self, packet: bytes) -> None:
        """Append one packet.  Raises `UserError` if the disk refuses."""
        self._write(serialise_record(packet))
        self._empty = False

    def _write(self, data: bytes) -> None:
        if self._write_failed:
            raise UserError(f"cannot write {self._path}: the disk refused before")
        unwritten = memoryview(data)
        try:
            while unwritten:
                # A disk that is nearly full writes a part.
                unwritten = unwritten[self._file.write(unwritten) :]
        except OSError as error:
            self._write_failed = True
            rest = "" if self._empty else f"; what was sent before is in {self._part}"
            raise UserError(f"cannot write {self._path}: {error.strerror}{rest}") from error

    def close(self) -> None:
        """Rename the file to `path`; closing twice has no further effect."""
        if self._file.closed:
            return
        self._file.close()
        if self._empty:
            self._part.unlink()
        elif not self._write_failed:
            self._part.replace(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class CallStreamWriter:
    """Writes a call to an open stream, such as standard output: a `PacketSink`.

    The stream stays open.  What it refuses raises `OSError`.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._write(MAGIC)

    @property
    def reachability(self) -> Reachability:
        """Whoever reads the stream."""
        return Reachability.HAS_PEER

    def send(self, packet: bytes) -> None:
        """Write one packet."""
        self._write(serialise_record(packet))

    def close(self) -> None:
        """Nothing waits to be written."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()


class CallReader:
    """Reads a call file, or the same bytes from an open stream: a `PacketSource`.

    A stream stays open when the reader is closed.
    """

    def __init__(self, source: Path | BinaryIO) -> None:
        self._is_own = isinstance(source, str | Path)
        try:
            # Open until `close`.
            self._file = open(source, "rb") if isinstance(source, str | Path) else source  # noqa: SIM115
        except OSError as error:
            raise cannot_read(source, error) from error
        self._records = read_records(self._file)
        self._complete = False
        self._ended = False

    @property
    def file_bytes(self) -> int:
        """Size of the file."""
        return fstat(self._file.fileno()).st_size

    @property
    def complete(self) -> bool:
        """Whether the END packet has been returned."""
        return self._complete

    @property
    def trailing_bytes(self) -> int:
        """Number of bytes of a file after the END packet, once that has been returned."""
        if not self._complete or not self._is_own:
            return 0
        return self.file_bytes - self._file.tell()

    @property
    def ended(self) -> bool:
        """Whether no further packet will be returned."""
        return self._ended

    def receive(self, timeout_s: float | None = None) -> bytes | None:
        """The next packet; None at the end.  Raises `ProtocolError` as `read_records` does."""
        try:
            packet = next(self._records, None)
        except ProtocolError:
            self._ended = True
            raise
        self._ended = packet is None
        self._complete = self._complete or (packet is not None and is_end(packet))
        return packet

    def __iter__(self) -> Iterator[bytes]:
        while (packet := self.receive()) is not None:
            yield packet

    def close(self) -> None:
        """Close the file."""
        if self._is_own:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _read_length(file: BinaryIO, offset: int) -> int | None:
    data = b""
    while not data or (data[-1] >= 0x80 and len(data) < MAX_LENGTH_BYTES):
        byte = file.read(1)
        if not byte:
            if data:
                raise TruncatedCall(offset, "in the length of a record")
            return None
        data += byte
    try:
        length, _ = decode_varint(data)
    except ValueError as error:
        raise ProtocolError(f"byte {offset}: length of a record: {error}") from error
    if not 1 <= length <= MAX_MODEL_PACKET_BYTES:
        raise ProtocolError(f"byte {offset}: record of {length} bytes")
    return length
