"""A network interface of this host whose address a test changes."""

import fcntl
import socket

import pytest


class OwnInterface:
    """The only interface of this host besides loopback.  address: None: it has none."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, address: str) -> None:
        self.address: str | None = address
        monkeypatch.setattr(socket, "if_nameindex", lambda: [(1, "net0")])
        monkeypatch.setattr(fcntl, "ioctl", self._ioctl)

    def _ioctl(self, probe: socket.socket, code: int, request: bytes) -> bytes:
        if self.address is None:
            raise OSError("Cannot assign requested address")
        return bytes(20) + socket.inet_aton(self.address)
