"""The number of source frames of a call file."""

from pathlib import Path

from decoder.playout.receiver import Receiver
from protocol.call_file import CallReader
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
    receiver = Receiver(on_damage=lambda error: None)
    return sum(len(receiver.receive(Arrival(packet, 0.0))) for packet in packets)
