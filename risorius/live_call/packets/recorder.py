"""Records one direction of a call that is under way, from any moment on."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Lock

from protocol.call_file import CallWriter
from protocol.errors import ProtocolError
from protocol.link.delivery.model_cache import ModelCache
from risorius.live_call.messages import Recording
from shared_model.errors import UserError


class CallRecorder:
    """Gets every packet of a call, and writes those of the times when it records.

    A file begins with the models that its frames need.  Each call has a file of its own.  One that
    cannot be written ends the recording, not the call.

    tell: called with what is recorded into whenever that changes, in the thread that changes it.
    Any thread may call the methods.
    """

    def __init__(self, tell: Callable[[Recording], None]) -> None:
        self._tell, self._lock = tell, Lock()
        self._models = ModelCache()
        self._file: CallWriter | None = None
        self._path: Path | None = None  # that the user has named; None: nothing is recorded
        self._calls = 0  # files of this recording that are complete
        self._has_packets = False  # whether the open one has

    def add(self, packet: bytes) -> None:
        """Take a serialised packet."""
        with self._lock:
            try:
                self._models.on_sent(packet)
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
            self._write(*self._models.packets)

    def forget(self) -> None:
        """Another call begins, with a model of its own; it is recorded into a file of its own."""
        with self._lock:
            self._models = ModelCache()
            if self._file is not None and self._has_packets:
                self._close()
                self._calls += 1

    def close(self) -> None:
        """Stop recording."""
        self.record(None)

    def _write(self, *packets: bytes) -> None:
        """Write packets if a file is wanted; opens it."""
        if self._path is None:
            return
        try:
            if self._file is None:
                self._open(self._path)
            assert self._file is not None
            for packet in packets:
                self._file.send(packet)
                self._has_packets = True
        except UserError as error:
            self._stop(str(error))

    def _open(self, path: Path) -> None:
        if self._calls:
            path = path.with_stem(f"{path.stem}-{self._calls + 1}")
        self._file, self._has_packets = CallWriter(path), False
        self._tell(Recording(path))

    def _stop(self, reason: str = "") -> None:
        was_recording, self._path = self._path is not None, None
        self._close()
        if was_recording:
            self._tell(Recording(None, reason))

    def _close(self) -> None:
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
        self._file = None
