"""Python objects between two processes of one program, over a pair of sockets.

Arrays go out of band (PEP 574): their bytes are neither copied nor is the interpreter held while
they are sent.  The heads, which both processes have, go by name.
"""

import io
import pickle
import socket
import struct
from typing import Any

from shared_model.mesh import Head, generic_head
from shared_model.surround import head_with_surround

_LENGTH = struct.Struct("<Q")
_HEADS = {"generic": generic_head, "with surround": head_with_surround}


class ObjectStream:
    """Sends and receives objects; one thread may send while another receives."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def send(self, message: object) -> None:
        """Send an object.  Raises `OSError` if the other process is gone."""
        arrays: list[pickle.PickleBuffer] = []
        body = io.BytesIO()
        _Pickler(body, protocol=5, buffer_callback=arrays.append).dump(message)
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
        return _Unpickler(io.BytesIO(body), buffers=arrays).load()

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
    def persistent_id(self, thing: object) -> str | None:
        if isinstance(thing, Head):
            return next((name for name, head in _HEADS.items() if head() is thing), None)
        return None


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, name: str) -> Head:
        return _HEADS[name]()
