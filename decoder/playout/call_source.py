"""Where the packets of a call come from."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from protocol.call_file import CallReader
from protocol.link.carriers import open_link_source
from protocol.link.interface import CONNECT_TIMEOUT_S, LinkOptions, MessageCallback, PacketSource
from protocol.security.link_security import LinkSecurity


@dataclass(frozen=True, slots=True)
class CallSource:
    """The source of a call, and the person that is drawn.

    call_file: a recorded call, or an open stream of one; None: over the network.
    listen, connect: endpoints (HOST:PORT, tcp/HOST:PORT); call: name of the call.
    security: what protects the call over the network.
    connect_timeout_s: time limit for connecting.
    face: call file whose person is drawn instead; None: the call's own.
    """

    call_file: Path | BinaryIO | None = None
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    call: str = "call"
    connect_timeout_s: float = CONNECT_TIMEOUT_S
    face: Path | None = None
    security: LinkSecurity = field(default_factory=LinkSecurity)


def open_packet_source(options: CallSource, on_message: MessageCallback) -> PacketSource:
    """The call file or the network, whichever the options name.  Raises `UserError`.

    on_message: called with a line when the link waits for an encoder.
    """
    if options.call_file is not None:
        return CallReader(options.call_file)
    link = LinkOptions(
        options.call,
        options.listen,
        options.connect,
        options.connect_timeout_s,
        security=options.security,
    )
    return open_link_source(link, on_message)


def call_name(options: CallSource) -> str:
    """The name of the call in messages."""
    if options.call_file is None:
        return f"call {options.call}"
    if isinstance(options.call_file, Path):
        return str(options.call_file)
    return "the call in the stream"
