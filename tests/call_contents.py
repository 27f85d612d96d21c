"""What call files hold, as tests read it: packets, and frames as they are played."""

from pathlib import Path

from decoder.playout.playout import Playout, PlayoutFrame
from protocol.call_file import CallReader
from protocol.call_records import TruncatedCall
from protocol.packets import Packet, parse_packet


def raw_packets(path: Path) -> list[bytes]:
    with CallReader(path) as reader:
        return list(reader)


def packets_of(path: Path) -> list[Packet]:
    return [parse_packet(data) for data in raw_packets(path)]


def played(path: Path) -> list[PlayoutFrame]:
    playout = Playout()
    return [frame for data in raw_packets(path) for frame in playout.receive(parse_packet(data))]


def count_packets(path: Path) -> int:
    """Whole packets in a call file that is still being written."""
    count = 0
    with path.open("rb") as file:
        try:
            for _ in CallReader(file):
                count += 1
        except TruncatedCall:
            return count
    return count
