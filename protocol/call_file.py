"""Call files (.rzo): the magic `RZO2`, then a record for each packet, see `call_records`.

A complete call ends with an END control packet.  A file without one is truncated, for example by an
interrupted encoder; its records up to there are valid.
"""

from collections.abc import Callable, Iterator
from os import fstat
from pathlib import Path
from time import monotonic
from typing import BinaryIO

from protocol.call_records import DamagedRecord, RecordReader, RecordWriter
from protocol.errors import ProtocolError
from protocol.link.interface import Arrival, PacketSink, PacketSource
from protocol.packets import is_end
from shared_model.errors import UserError, cannot_read, cannot_write

MAGIC = b"RZO2"


class CallWriter(PacketSink):
    """Writes a call file: a `PacketSink`.

    The file is written under a temporary name next to `path` and renamed on closing, so `path`
    never ends within a record.  Leaving the `with` block by an exception closes the file as well
    and keeps the packets sent so far, under the temporary name if it is an error and there is an
    older file, which may be complete; without any packet no file is left.  After a failed write
    nothing more can be sent: the temporary file remains if it has a packet, and `path` is
    unchanged.
    """

    def __init__(self, path: Path) -> None:
        self._path = Path(path)
        self._part = self._path.with_name(self._path.name + ".part")
        self._empty, self._write_failed = True, False
        self._keeps_older = False
        self._records = RecordWriter()
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

    def send(self, packet: bytes) -> None:
        """Append one packet.  Raises `UserError` if the disk refuses."""
        self._write(self._records.record(packet))
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
        elif not self._write_failed and not self._keeps_older:
            self._part.replace(self._path)

    def __exit__(self, *exception: object) -> None:
        """Close; after an error an older file stays."""
        is_error = any(isinstance(each, Exception) for each in exception)
        self._keeps_older = is_error and self._path.exists()
        super().__exit__(*exception)


class CallStreamWriter(PacketSink):
    """Writes a call to an open stream, such as standard output: a `PacketSink`.

    The stream stays open.  Raises `OSError` if it cannot be written.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._records = stream, RecordWriter()
        self._write(MAGIC)

    def send(self, packet: bytes) -> None:
        """Write one packet."""
        self._write(self._records.record(packet))

    def close(self) -> None:
        """Do nothing: each packet has been flushed."""

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()


class CallReader(PacketSource):
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
        self._records: RecordReader | None = None
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
    def offset(self) -> int:
        """Offset of the next record in the file, bytes."""
        return self._records.offset if self._records else 0

    @property
    def trailing_bytes(self) -> int:
        """Number of bytes of a file after the END packet, once that has been returned."""
        if not self._complete or not self._is_own:
            return 0
        return self.file_bytes - self.offset

    @property
    def ended(self) -> bool:
        """Whether no further packet will be returned."""
        return self._ended

    def receive(self, timeout_s: float | None = None) -> Arrival | None:
        """The next packet, None at the end; its time is that of reading it.

        Raises `ProtocolError` if it is not a call file, `DamagedRecord`, after which reading
        continues after the damage, and `TruncatedCall` if the file ends within a record.
        """
        if self._ended:
            return None
        try:
            packet = self._opened().read()
        except DamagedRecord:
            raise
        except ProtocolError:
            self._ended = True
            raise
        self._complete = packet is not None and is_end(packet)
        self._ended = packet is None or self._complete
        return None if packet is None else Arrival(packet, monotonic())

    def undamaged(self, on_damage: Callable[[ProtocolError], None]) -> Iterator[bytes]:
        """All packets that can be read; the errors of the others are passed to `on_damage`."""
        while not self._ended:
            try:
                arrival = self.receive()
            except ProtocolError as error:
                on_damage(error)
                continue
            if arrival is not None:
                yield arrival.data

    def _opened(self) -> RecordReader:
        if self._records is None:
            head = self._file.read(len(MAGIC))
            if head != MAGIC:
                raise ProtocolError(f"no call file: it does not begin with {MAGIC.decode()}")
            self._records = RecordReader(self._file, len(MAGIC))
        return self._records

    def close(self) -> None:
        """Close the file."""
        if self._is_own:
            self._file.close()
