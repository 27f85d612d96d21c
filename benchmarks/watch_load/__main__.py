"""Measures what pages that watch a call cost the relay that serves them.

    python -m benchmarks watch_load CALL.rzo --pages 1,100,1000

A relay, an encoder that sends the call file's frame packets, 3.1 a second, and one process with all
pages: each does over a WebSocket of its own what a page's end of the link does, and draws nothing.
The call is open: SFrame costs the relay nothing.  Prints a line of JSON for each number of pages:
how long after the last page was opened all had the model, and the CPU (cores) of the relay until
then; of the time after that the share of the frame packets that came, their delay (median and 95th
percentile), CPU of the relay and of the encoder's end, bits a second that come back to the encoder,
and the relay's memory.
"""

import argparse
import json
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from benchmarks.command import run
from benchmarks.delay_figures import median_and_p95_ms
from benchmarks.measured_process import (
    cpu_s,
    memory_bytes,
    next_line,
    start_module,
    start_relay,
)
from benchmarks.watch_load.sending import Sending
from loopback.process_pair import free_port

CALL = "watched"
# The module of the pages.
PAGES = "benchmarks.watch_load.pages"


def main(argv: Sequence[str]) -> None:
    """Print one line of JSON for each number of pages."""
    parser = argparse.ArgumentParser(
        prog="watch_load", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("call", type=Path, help="a call file; it begins again at its end")
    parser.add_argument("--pages", default="1,100,1000", help="with commas between them")
    parser.add_argument("--per-second", type=float, default=1000.0, help="pages that are opened")
    parser.add_argument("--seconds", type=float, default=20.0, help="to measure")
    options = parser.parse_args(argv)
    for pages in map(int, options.pages.split(",")):
        figures = measure(options.call, pages, options.per_second, options.seconds)
        print(json.dumps(figures), flush=True)


def measure(call: Path, pages: int, per_second: float, seconds: float) -> dict[str, object]:
    """The figures of so many pages of one call."""
    with ExitStack() as stack:
        place = f"tcp/127.0.0.1:{free_port()}"
        relay, line = start_relay(stack, ["--listen", place, "--watch", "0"], "watched at")
        port = line.split("HOST:")[1].split("/")[0]
        sending = stack.enter_context(Sending(call, CALL, place))
        watching = start_module(stack, PAGES, port, CALL, pages, per_second)
        next_line(watching, "open")
        begun_s, before_s = time.monotonic(), cpu_s(relay.pid)
        next_line(watching, "all have the model")
        joined_s = time.monotonic() - begun_s
        joining_cores = (cpu_s(relay.pid) - before_s) / max(joined_s, 1e-3)
        before_s, sent_s, back = cpu_s(relay.pid), time.process_time(), sending.bytes_back
        begun_s = time.monotonic()
        sent = sending.send(seconds)
        took_s = time.monotonic() - begun_s
        relay_cores = (cpu_s(relay.pid) - before_s) / took_s
        sender_cores = (time.process_time() - sent_s) / took_s
        back_bps = 8 * (sending.bytes_back - back) / took_s
        assert watching.stdin is not None
        watching.stdin.close()
        came = json.loads(next_line(watching))
        delays = [now_s - sent[key] for key, now_s in came if key in sent]
        return {
            "pages": pages,
            "all_joined_s": round(joined_s, 1),
            "share": round(len(delays) / (len(sent) * pages), 4),
            "delay_ms": median_and_p95_ms(delays),
            "relay_cores_joining": round(joining_cores, 3),
            "relay_cores": round(relay_cores, 3),
            "encoder_cores": round(sender_cores, 3),
            "back_bps": round(back_bps),
            "relay_mb": round(memory_bytes(relay.pid) / 1e6, 1),
        }


if __name__ == "__main__":
    run(main)
