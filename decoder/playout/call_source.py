"""Where the packets of a call come from."""

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from protocol.call_file import CallReader
from protocol.link.carriers import open_link_source
from protocol.link.interface import LinkOptions, MessageCallback, PacketSource


@dataclass(frozen=True, slots=True)
class CallSource:
    """The source of a call, and the person that is drawn.

    call_file: a recorded call, or an open stream of one; None: over the network.
    link: the network that it comes over, where there is no call file.
    face: call file whose person is drawn instead; None: the call's own.
    """

    call_file: Path | BinaryIO | None = None
    link: LinkOptions | None = None
    face: Path | None = None


def open_packet_source(options: CallSource, on_message: MessageCallback) -> PacketSource:
    """The call file or the network, whichever the options name.  Raises `UserError`.

    on_message: called with a line when the link waits for an encoder.
    """
    if options.call_file is not None:
        return CallReader(options.call_file)
    if options.link is None:
        raise ValueError("options have neither call file nor link, expected one of them")
    return open_link_source(options.link, on_message)


def call_name(options: CallSource) -> str:
    """The name of the call in messages."""
    if options.link is not None:
        return f"call {options.link.call}"
    if isinstance(options.call_file, Path):
        return str(options.call_file)
    return "the call in the stream"
