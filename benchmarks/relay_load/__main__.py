"""Measures what relays carry.

    python -m benchmarks relay_load --subscribers 1,10,50 --relays 1,2
    python -m benchmarks relay_load --calls 100,300 --subscribers 1

All on this host's loopback, each end with a session of its own; a subscriber parses what comes.  A
packet is as long as a frame packet of 800 bit/s with SFrame, and each call has 3.1 a second.  With
two relays the callers are at one, the subscribers at the other.  Prints a line of JSON for each
combination: the share of the packets that came, their delay (median and 95th percentile), CPU
(cores) of the callers' process and of each relay, the largest relay's memory, and how many packets
a second one core of the busiest relay would send, if its CPU grows with them.
"""

import argparse
import json
import time
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import product

from benchmarks.command import run
from benchmarks.delay_figures import median_and_p95_ms
from benchmarks.measured_process import (
    Process,
    cpu_s,
    memory_bytes,
    next_line,
    start_module,
    start_relay,
)
from benchmarks.relay_load.ends import PACKETS_PER_S
from loopback.process_pair import free_port

# The module of the ends.
ENDS = "benchmarks.relay_load.ends"
# For how long no packet may come until those that are still on their way are given up.
PATIENCE_S = 1.0


def main(argv: Sequence[str]) -> None:
    """Print one line of JSON for each number of calls, subscribers and relays."""
    parser = argparse.ArgumentParser(
        prog="relay_load", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--calls", type=_numbers, default=(1,), help="with commas between them")
    parser.add_argument("--subscribers", type=_numbers, default=(1,), help="of each call")
    parser.add_argument("--relays", type=_numbers, default=(1,), help="1 or 2, in a row")
    parser.add_argument("--seconds", type=float, default=20.0, help="to measure")
    parser.add_argument("--scheme", default="udp", choices=("udp", "tcp"))
    options = parser.parse_args(argv)
    for calls, subscribers, relays in product(options.calls, options.subscribers, options.relays):
        figures = measure(calls, subscribers, relays, options.seconds, options.scheme)
        print(json.dumps(figures), flush=True)


def measure(
    calls: int,
    subscribers: int,
    relays: int,
    seconds: float,
    scheme: str,
    patience_s: float = PATIENCE_S,
) -> dict[str, object]:
    """The figures of so many relays in a row; subscribers: of each call."""
    with ExitStack() as stack:
        places = [f"{scheme}/127.0.0.1:{free_port()}" for _ in range(relays)]
        running = [_relay(stack, places, number) for number in range(relays)]
        subscribing = start_module(stack, ENDS, "subscribers", places[-1], calls, subscribers)
        next_line(subscribing, "ready")
        calling = start_module(stack, ENDS, "callers", places[0], calls, seconds)
        next_line(calling, "ready")
        next_line(subscribing, "all have received")
        before, begun_s = [cpu_s(relay.pid) for relay in running], time.monotonic()
        assert calling.stdin is not None and subscribing.stdin is not None
        calling.stdin.write("begin\n")
        calling.stdin.flush()
        sent, caller_s = json.loads(next_line(calling))
        took_s = time.monotonic() - begun_s
        cores = [(cpu_s(r.pid) - b) / took_s for r, b in zip(running, before, strict=True)]
        memory = max(memory_bytes(relay.pid) for relay in running)
        subscribing.stdin.write(f"{sent * subscribers} {patience_s}")
        subscribing.stdin.close()
        delays = json.loads(next_line(subscribing))
    return {
        "calls": calls,
        "subscribers": subscribers,
        "relays": relays,
        "scheme": scheme,
        "share": round(len(delays) / (sent * subscribers), 4),
        "delay_ms": median_and_p95_ms(delays),
        "caller_cores": round(caller_s / took_s, 4),
        "relay_cores": [round(value, 4) for value in cores],
        "relay_mb": round(memory / 1e6, 1),
        "sent_per_core_s": round(calls * subscribers * PACKETS_PER_S / max(*cores, 1e-6)),
    }


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(",")))


def _relay(stack: ExitStack, places: Sequence[str], number: int) -> Process:
    """Relay `number`, which connects to the one before it; it listens when this returns."""
    upstream = ["--connect", places[number - 1]] if number else []
    arguments = ["--listen", places[number], "--max-peers", "10000", *upstream]
    return start_relay(stack, arguments, "listening")[0]


if __name__ == "__main__":
    run(main)
