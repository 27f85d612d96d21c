"""Ends of a call on loopback, and packets that say which they are."""

import socket
from dataclasses import replace

from packets import MODEL
from processes import LIMIT_S

from protocol.link.interface import LinkOptions
from protocol.link.link_source import LinkSource
from protocol.packets import ControlKind, ControlPacket, FramePacket, serialise

END = serialise(ControlPacket(0, ControlKind.END, 100))
MODEL_BYTES = serialise(replace(MODEL, sequence=0))
WAIT_S = LIMIT_S


def frame(number: int) -> bytes:
    """A frame packet that says which it is."""
    return serialise(FramePacket(number % 64, number.to_bytes(10, "big")))


def free_endpoint(scheme: str = "tcp") -> str:
    """A loopback endpoint on a port that the system has just called free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{scheme}/127.0.0.1:{probe.getsockname()[1]}"


def listening(endpoint: str, lossless: bool = True) -> LinkOptions:
    return LinkOptions("test", listen=(endpoint,), lossless=lossless)


def connecting(endpoint: str, lossless: bool = True) -> LinkOptions:
    return LinkOptions("test", connect=(endpoint,), connect_timeout_s=WAIT_S, lossless=lossless)


def received(source: LinkSource) -> bytes | None:
    """The next packet."""
    arrival = source.receive(WAIT_S)
    return None if arrival is None else arrival.data


def port_of(endpoint: str) -> int:
    """The port of an endpoint."""
    return int(endpoint.rsplit(":", 1)[1])
