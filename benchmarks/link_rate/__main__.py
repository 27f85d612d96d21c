"""What a call weighs on the wire, with the headers of IP and UDP, both ways (Linux, root).

    python -m benchmarks link_rate call.rzo

Two hosts of their own (network namespaces), 50 ms one way, nothing lost.  The encoder's end plays
the call file: its model, then its frame packets over and over at their times.  Prints a line of
JSON about the file: bits a second of payload, and the bytes that a file of a minute of it takes;
then one for each end that may connect and each protection: bits a second
from the encoder, back, and together, in the steady state from `SETTLED_S` on.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults, end
from benchmarks.command import run
from protocol.summary import CallSummary, summarise
from shared_model.errors import UserError

ADDRESSES = ("10.79.0.1", "10.79.0.2")
DELAY_MS = 50.0
# Until then model, measurements of the link and first reports go over it.
SETTLED_S = 12
# How long both ends may take to start and to end.
PATIENCE_S = 60.0
MINUTE_S = 60.0


def main(argv: Sequence[str]) -> None:
    """Print one line of JSON for each combination."""
    parser = argparse.ArgumentParser(
        prog="link_rate", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("call", type=Path, metavar="CALL", help="call file")
    parser.add_argument("--seconds", type=int, default=40, help="to play")
    parser.add_argument("--scheme", default="udp", choices=("udp", "tcp"))
    options = parser.parse_args(argv)
    if (reason := obstacle()) is not None:
        raise UserError(reason)
    print(json.dumps(file_figures(summarise(options.call))), flush=True)
    for connects, protection in product(("encoder", "decoder"), ("insecure", "sframe")):
        measured = (options.seconds, options.scheme, connects == "encoder", protection)
        forward, back = measure(options.call, *measured)
        figures = {"connects": connects, "protection": protection, "scheme": options.scheme}
        figures |= {"forward_bps": forward, "back_bps": back, "both_bps": forward + back}
        print(json.dumps(figures), flush=True)


def file_figures(summary: CallSummary) -> dict[str, int]:
    """What a call file takes, without and with its model."""
    over_time = summary.file_bytes - summary.model_bytes
    minute_bytes = summary.model_bytes + over_time * MINUTE_S / summary.duration_s
    return {
        "frame_bps": round(summary.frame_bps),
        "voice_bps": round(summary.voice_bps),
        "payload_bps": round(summary.frame_bps + summary.voice_bps),
        "minute_bytes": round(minute_bytes),
    }


def measure(
    call: Path, seconds: int, scheme: str, encoder_connects: bool, protection: str
) -> tuple[int, int]:
    """Bits a second from the encoder and back, with the headers of IP.  Raises `UserError`."""
    endpoint = f"{scheme}/{ADDRESSES[0]}:7447"
    roles = ("take", "play") if encoder_connects else ("play", "take")
    with BadWire(ADDRESSES, Faults(delay_ms=DELAY_MS)) as wire:
        processes = []
        for host, role, how in zip(wire.hosts, roles, ("listen", "connect"), strict=True):
            arguments = (role, how, endpoint, protection, str(call.resolve()), str(seconds))
            command = [sys.executable, "-m", "benchmarks.link_rate.ends", *arguments]
            processes.append(host.run(command, sys.stderr.buffer, dict(os.environ)))
        try:
            _wait(processes, seconds + PATIENCE_S)
        finally:
            for process in processes:
                end(process)
        begun_s = min(min(host.traffic.bytes_by_second) for host in wire.hosts)
        settled = range(begun_s + SETTLED_S, begun_s + seconds - 1)
        rates = [
            round(
                8 * sum(host.traffic.bytes_by_second[second] for second in settled) / len(settled)
            )
            for host in wire.hosts
        ]
    forward, back = rates[::-1] if encoder_connects else rates
    return forward, back


def _wait(processes: "Sequence[subprocess.Popen[bytes]]", limit_s: float) -> None:
    deadline = time.monotonic() + limit_s
    for process in processes:
        try:
            code = process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            raise UserError("the ends of the call did not end in time") from None
        if code:
            raise UserError(f"an end of the call stopped with {code}")


if __name__ == "__main__":
    run(main)
