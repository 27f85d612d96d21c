"""Records one direction of a call that is under way, from any moment on."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Lock

from protocol.call_file import CallWriter
from protocol.errors import ProtocolError
from protocol.packets import ControlKind, ControlPacket, serialise
from risorius.live_call.messages import Recording
from risorius.live_call.packets.call_position import CallPosition
from shared_model.errors import UserError


class CallRecorder:
    """Gets every packet of a call, and writes those of the times when it records.

    A file begins with the first face that comes while it records, after the models that its frames
    need, and ends with the number of its source frames.  Each call has a file of its own.  One that
    cannot be written ends the recording, not the call.

    tell: called with what is recorded into whenever that changes, in the thread that changes it.
    Any thread may call the methods.
    """

    def __init__(self, tell: Callable[[Recording], None]) -> None:
        self._tell, self._lock = tell, Lock()
        self._position, self._session = CallPosition(), 0
        self._file: CallWriter | None = None
        self._path: Path | None = None  # that the user has named; None: nothing is recorded
        self._calls = 0  # files of this recording that are complete
        self._begin: int | None = None  # first source frame of the open file; None: it is empty

    def add(self, packet: bytes, number: int | None = None, session: int = 0) -> None:
        """Take a serialised packet.  number, session: see `Arrival`."""
        with self._lock:
            if session < self._session:
                return
            if session > self._session:
                self._begin_call(session)
            if self._position.is_over:
                return
            try:
                self._position.add(packet, number)
            except ProtocolError:
                return
            self._write(packet)

    def record(self, path: Path | None) -> None:
        """Record into a new call file from now on; None: stop."""
        with self._lock:
            self._stop()
            if path is None:
                return
            self._path, self._calls = path, 0
            if self._position.has_model and not self._position.is_over:
                self._try(self._open)

    def forget(self) -> None:
        """Begin another call, whose model and whose file are its own."""
        with self._lock:
            self._begin_call(0)

    def close(self) -> None:
        """Stop recording."""
        self.record(None)

    def _begin_call(self, session: int) -> None:
        if self._begin is not None:
            self._try(self._finish)
        self._position, self._session = CallPosition(), session

    def _write(self, packet: bytes) -> None:
        """Write the newest packet if it is wanted; opens the file."""
        if self._path is not None:
            self._try(lambda: self._append(packet))

    def _append(self, packet: bytes) -> None:
        position = self._position
        file = self._file or self._open()
        if self._begin is None and position.begin is not None:
            self._begin = position.begin
            for each in position.head:
                file.send(each)
        if position.is_over:
            self._finish()
        elif self._begin is not None:
            file.send(packet)

    def _open(self) -> CallWriter:
        assert self._path is not None
        path = self._path
        if self._calls:
            path = path.with_stem(f"{path.stem}-{self._calls + 1}")
        self._file = CallWriter(path)
        self._tell(Recording(path))
        return self._file

    def _finish(self) -> None:
        """Complete the open file, if there is one; one without a frame is removed."""
        if self._file is None:
            return
        file, begin, self._file, self._begin = self._file, self._begin, None, None
        try:
            if begin is not None:
                frames = self._position.end - begin
                file.send(serialise(ControlPacket(0, ControlKind.END, frames)))
                self._calls += 1
        finally:
            with suppress(OSError):
                file.close()

    def _stop(self, reason: str = "") -> None:
        path, self._path = self._path, None
        try:
            self._finish()
        except UserError as error:
            reason = reason or str(error)
        if path is None:
            return
        if not self._calls:
            reason = reason or f"{path} is not there: no face came while it was recorded"
        self._tell(Recording(None, reason))

    def _try(self, write: Callable[[], object]) -> None:
        """Do what may fail; then recording ends."""
        try:
            write()
        except UserError as error:
            self._stop(str(error))
