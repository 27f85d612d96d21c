"""Python objects between two processes of one program, over a pair of sockets.

Arrays go out of band (PEP 574): their bytes are neither copied nor is the interpreter held while
they are sent.  What both processes have goes by name.
"""

import io
import pickle
import socket
import struct
from collections.abc import Callable, Mapping
from typing import Any

_LENGTH = struct.Struct("<Q")


class ObjectStream:
    """Sends and receives objects; one thread may send while another receives.

    shared: what returns the objects that both processes have, by their names.
    """

    def __init__(
        self, connection: socket.socket, shared: Mapping[str, Callable[[], object]] | None = None
    ) -> None:
        self._connection, self._shared = connection, shared or {}

    def send(self, message: object) -> None:
        """Send an object.  Raises `OSError` if the other process is gone."""
        arrays: list[pickle.PickleBuffer] = []
        body = io.BytesIO()
        _Pickler(body, self._shared, arrays.append).dump(message)
        parts = [body.getbuffer(), *(array.raw() for array in arrays)]
        sizes = b"".join(_LENGTH.pack(part.nbytes) for part in parts)
        self._connection.sendall(_LENGTH.pack(len(parts)) + sizes)
        for part in parts:
            self._connection.sendall(part)

    def receive(self) -> Any:
        """The next object.  Raises `EOFError` if the other process is gone."""
        (count,) = _LENGTH.unpack(self._read(_LENGTH.size))
        sizes = struct.unpack(f"<{count}Q", self._read(count * _LENGTH.size))
        body, *arrays = map(self._read, sizes)
        return _Unpickler(io.BytesIO(body), self._shared, arrays).load()

    def end(self) -> None:
        """Send nothing more; the other process' `receive` raises `EOFError`, it may still send.

        Raises `OSError` if the other process is gone.
        """
        self._connection.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """End the connection; the other process' `receive` raises `EOFError`."""
        self._connection.close()

    def _read(self, count: int) -> bytearray:
        data = bytearray(count)
        view, done = memoryview(data), 0
        while done < count:
            try:
                received = self._connection.recv_into(view[done:])
            except OSError as error:
                raise EOFError from error
            if not received:
                raise EOFError
            done += received
        return data


class _Pickler(pickle.Pickler):
    def __init__(
        self,
        body: io.BytesIO,
        shared: Mapping[str, Callable[[], object]],
        keep: Callable[[pickle.PickleBuffer], object],
    ) -> None:
        super().__init__(body, protocol=5, buffer_callback=keep)
        self._names = {id(find()): name for name, find in shared.items()}

    def persistent_id(self, thing: object) -> str | None:
        return self._names.get(id(thing))


class _Unpickler(pickle.Unpickler):
    def __init__(
        self,
        body: io.BytesIO,
        shared: Mapping[str, Callable[[], object]],
        arrays: list[bytearray],
    ) -> None:
        super().__init__(body, buffers=arrays)
        self._shared = shared

    def persistent_load(self, name: str) -> object:
        return self._shared[name]()
