"""The two ends of a measured call, as processes: a call file in, what arrived out.

    python -m benchmarks reliability.ends send connect ENDPOINT insecure|sframe LOG CALL
    python -m benchmarks reliability.ends receive listen|connect ENDPOINT insecure|sframe LOG

The sender sends the packets of a call file at the times of their source frames.  Times in the logs
are of `time.monotonic`, which both ends share.
"""

import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.simulated_link import sent_packets
from protocol.discovery import CallAnnouncer, FoundCall
from protocol.endpoint import OwnAddress, parse_endpoint
from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.interface import LinkOptions
from protocol.packets import PacketKind, packet_kind
from protocol.security.link_security import LinkSecurity

CALL = "call"
# No secret: both ends are in one measurement.
KEY = bytes(range(16))
# How long an end waits for the other.
WAIT_S = 60.0


def main(arguments: Sequence[str]) -> None:
    """Run one of the ends."""
    role, how, place, protection, log, *call = arguments
    security = LinkSecurity(KEY if protection == "sframe" else None, trusts_network=True)
    where = {how: (place,)}
    options = LinkOptions(CALL, **where, connect_timeout_s=WAIT_S, security=security)  # type: ignore[arg-type]
    if role == "send":
        send(options, Path(log), Path(call[0]))
    elif how == "connect":
        receive(options, Path(log))
    else:
        own = parse_endpoint(place)
        found = FoundCall(CALL, "", own.port, is_encoder=False, needs_invitation=False)
        with CallAnnouncer(found, None, OwnAddress(own.host)):
            receive(options, Path(log))


def send(options: LinkOptions, log: Path, call: Path) -> None:
    """Send a call, and log a line for each frame packet, with the link as it is then."""
    packets = sent_packets(call)
    with log.open("w", encoding="utf-8") as lines:
        _write(lines.write, t=time.monotonic(), what="started")
        with open_link_sink(options, print) as sink:
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
            # Another process may be waiting for this line.
            lines.flush()
            for each in packets:
                time.sleep(max(0.0, begun + each.sent_s - time.monotonic()))
                sent_s = time.monotonic()
                sink.send(each.data)
                if packet_kind(each.data) is PacketKind.FRAME:
                    number, loss = each.number, sink.quality.loss
                    _write(lines.write, t=sent_s, what="sent", number=number, loss=loss)
                    lines.flush()
        _write(lines.write, t=time.monotonic(), what="ended", reach=sink.reachability)


def receive(options: LinkOptions, log: Path) -> None:
    """Receive a call, and log a line for each packet."""
    with log.open("w", encoding="utf-8") as lines:
        _write(lines.write, t=time.monotonic(), what="started")
        with open_link_source(options, print) as source:
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
