"""The two ends of a measured call, as processes: a call file in, what arrived out.

    python -m scripts.reliability.ends send CALL LOG ENDPOINT LEAST_S
    python -m scripts.reliability.ends receive LOG ENDPOINT

The sender sends the packets of a call file at the times of their source frames, and the frame
packets again until LEAST_S seconds have passed.  Times in the logs are of `time.monotonic`, which
both ends share.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from loopback.simulated_link import SentPacket, sent_packets
from protocol.limits import SEQUENCE_MODULUS
from protocol.link.interface import LinkOptions
from protocol.link.zenoh_link import ZenohSink, ZenohSource
from protocol.packets import PacketKind, is_end, packet_kind

CALL = "call"
# How long an end waits for the other.
WAIT_S = 60.0


def main(arguments: Sequence[str]) -> None:
    """Run one of the ends."""
    if arguments[0] == "send":
        _, call, log, place, least_s = arguments
        send(Path(call), Path(log), place, float(least_s))
    else:
        _, log, place = arguments
        receive(Path(log), place)


def send(call: Path, log: Path, place: str, least_s: float) -> None:
    """Send a call, and log a line for each frame packet, with the link as it is then."""
    packets = list(lengthened(sent_packets(call), least_s))
    with log.open("w", encoding="utf-8") as lines:
        _write(lines.write, t=time.monotonic(), what="started")
        options = LinkOptions(CALL, connect=(place,), connect_timeout_s=WAIT_S)
        with ZenohSink(options, print) as sink:
            sink.wait_for_peer(WAIT_S)
            begun = time.monotonic()
            quality = sink.quality
            _write(
                lines.write,
                t=begun,
                what="met",
                rate_bps=quality.rate_bps,
                round_trip_s=quality.round_trip_s,
            )
            for each in packets:
                time.sleep(max(0.0, begun + each.sent_s - time.monotonic()))
                sink.send(each.data)
                if packet_kind(each.data) is PacketKind.FRAME:
                    number, loss = each.number, sink.quality.loss
                    _write(lines.write, t=time.monotonic(), what="sent", number=number, loss=loss)
                    lines.flush()
        _write(lines.write, t=time.monotonic(), what="ended", reach=sink.reachability)


def lengthened(packets: list[SentPacket], least_s: float) -> Iterator[SentPacket]:
    """The packets of a call that lasts so long at least, with frame packets again at its end.

    Their numbers go on; what is shown of them means nothing.
    """
    frames = [each for each in packets if packet_kind(each.data) is PacketKind.FRAME]
    yield from (each for each in packets if not is_end(each.data))
    pause_s = frames[-1].sent_s - frames[-2].sent_s
    number, now_s = len(frames), frames[-1].sent_s
    while now_s < least_s:
        again = frames[number % len(frames)]
        now_s += pause_s
        yield SentPacket(bytes([number % SEQUENCE_MODULUS]) + again.data[1:], now_s, number)
        number += 1
    yield SentPacket(packets[-1].data, max(now_s, packets[-1].sent_s), number)


def receive(log: Path, place: str) -> None:
    """Receive a call, and log a line for each packet."""
    with log.open("w", encoding="utf-8") as lines:
        _write(lines.write, t=time.monotonic(), what="started")
        with ZenohSource(LinkOptions(CALL, listen=(place,)), print) as source:
            while (arrival := source.receive()) is not None:
                _write(
                    lines.write,
                    t=arrival.time_s,
                    what="came",
                    session=arrival.session,
                    number=arrival.number,
                    data=arrival.data.hex(),
                )
                lines.flush()
        _write(lines.write, t=time.monotonic(), what="ended", complete=source.complete)


def _write(write: Callable[[str], object], **fields: object) -> None:
    write(json.dumps(fields) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
