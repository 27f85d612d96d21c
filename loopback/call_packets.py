"""The packets of a call file, one after the other."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.packets import Packet, parse_packet


def call_packets(call: Path) -> Iterator[tuple[Packet, int]]:
    """Each packet of a call file that can be read, and its bytes."""
    with CallReader(call) as reader:
        for data in reader.undamaged(lambda error: None):
            with suppress(ProtocolError):
                yield parse_packet(data), len(data)
