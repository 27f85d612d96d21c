"""The two ends of a measured call: one plays a call file, the other takes what comes."""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path

from protocol.call_file import CallReader
from protocol.limits import SEQUENCE_MODULUS
from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.interface import LinkOptions
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, parse_packet, serialise
from protocol.security.link_security import LinkSecurity

# No secret: both ends are in one measurement.
KEY = bytes(range(16))
CALL = "anna"
WAIT_S = 30.0
NAP_S = 0.005


def main(arguments: Sequence[str]) -> None:
    """play|take listen|connect ENDPOINT insecure|sframe CALL_FILE SECONDS."""
    what, how, endpoint, protection, path, seconds = arguments
    security = LinkSecurity(KEY if protection == "sframe" else None)
    place = {how: (endpoint,)}
    options = LinkOptions(CALL, **place, connect_timeout_s=WAIT_S, security=security)  # type: ignore[arg-type]
    if what == "play":
        play(options, Path(path), float(seconds))
    else:
        take(options)


def play(options: LinkOptions, path: Path, seconds: float) -> None:
    """Send the model of a call file, then for `seconds` its frame packets, over and over, each at
    its time."""
    with CallReader(path) as reader:
        packets = [parse_packet(data) for data in reader]
    (model, *_) = [packet for packet in packets if isinstance(packet, ModelPacket)]
    frames = cycle([packet for packet in packets if isinstance(packet, FramePacket)])
    interval_s = model.call.frames_per_packet / model.call.fps
    with open_link_sink(options) as sink:
        sink.wait_for_peer(WAIT_S)
        sink.send(serialise(model))
        begun_s, sent = time.monotonic(), 0
        while (elapsed_s := time.monotonic() - begun_s) < seconds:
            if sent * interval_s <= elapsed_s:
                sink.send(serialise(replace(next(frames), sequence=sent % SEQUENCE_MODULUS)))
                sent += 1
            time.sleep(NAP_S)
        count = sent * model.call.frames_per_packet
        sink.send(serialise(ControlPacket(sent % SEQUENCE_MODULUS, ControlKind.END, count)))


def take(options: LinkOptions) -> None:
    """Receive until the end of the call."""
    with open_link_source(options) as source:
        while source.receive(WAIT_S) is not None:
            pass


if __name__ == "__main__":
    main(sys.argv[1:])
