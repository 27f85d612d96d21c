"""The number of source frames of a call file."""

from contextlib import suppress
from pathlib import Path

from decoder.playout.encoder_session import EncoderSession
from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.link.interface import Arrival
from protocol.packets import ControlPacket, parse_packet


def count_frames(path: Path) -> int:
    """The number in the END packet; of a truncated call, the frames that its packets yield.

    Raises `UserError` if the file cannot be read.
    """
    packets = list[bytes]()
    with CallReader(path) as reader:
        packets += reader.undamaged(lambda damage: None)
        last = parse_packet(packets[-1]) if reader.complete else None
        if isinstance(last, ControlPacket):
            return last.frame
    session, shown = EncoderSession(), 0
    for packet in packets:
        with suppress(ProtocolError):
            for _ in session.receive(Arrival(packet, 0.0)):
                shown += 1
    return shown
