"""Records one direction of a call that is under way, from any moment on."""

from pathlib import Path
from threading import Lock

from protocol.call_file import CallWriter
from protocol.errors import ProtocolError
from protocol.link.delivery.model_cache import ModelCache


class CallRecorder:
    """Gets every packet of a call, and writes those of the times when it records.

    A file begins with the models that its frames need.  `record` may be called in any thread.
    """

    def __init__(self) -> None:
        self._models, self._lock = ModelCache(), Lock()
        self._file: CallWriter | None = None

    def add(self, packet: bytes) -> None:
        """Take a serialised packet.  Raises `UserError` if it cannot be written."""
        with self._lock:
            try:
                self._models.on_sent(packet)
            except ProtocolError:
                return
            if self._file is not None:
                self._file.send(packet)

    def record(self, path: Path | None) -> None:
        """Record into a new call file from now on; None: stop.  Raises `UserError`."""
        with self._lock:
            if self._file is not None:
                self._file.close()
                self._file = None
            if path is not None:
                self._file = CallWriter(path)
                for packet in self._models.packets:
                    self._file.send(packet)

    def forget(self) -> None:
        """Another call begins, with a model of its own."""
        with self._lock:
            self._models = ModelCache()

    def close(self) -> None:
        """Stop recording."""
        self.record(None)
