"""How soon a page that watches shows the first picture over a thin link (Linux, root).

    python -m benchmarks first_picture CLIP [--rate BPS] [--delay MS] [--startup BPS] [--after S]

A caller waits for somebody over a wire that carries BPS bits a second each way, IP and UDP headers
included; at its other end is a relay that serves the page, and the browser: the player comes from
there.  The clip is sent at its own rate.  The table: from opening the page, to which the caller
answers, to its first picture; and of a second page, opened when the first has seen S seconds.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults
from benchmarks.browser import Browser, find_browser
from benchmarks.command import PROGRAM, run
from benchmarks.measured_process import holds_within
from benchmarks.played_letter import SOFTWARE_GL
from loopback.report import Cell, table
from shared_model.errors import UserError

RELAY, CALLER = "10.77.0.1", "10.77.0.2"
ENDPOINT, WATCH_PORT, CALL = f"udp/{RELAY}:7447", 8080, "anna"
PAGE = f"http://{RELAY}:{WATCH_PORT}/{CALL}"
HEADER = ("page", "call answers, s", "model is there, s", "first picture, s", "kB until then")
# Until the relay serves its page, the caller is ready, and a page shows a picture.
BEGIN_S, READY_S, LIMIT_S = 30.0, 60.0, 120.0
# What a page notes.
TIMES = """
window.times = {};
const note = (name, isThere) => {
  if (times[name] === undefined && isThere) times[name] = performance.now() / 1000;
};
setInterval(() => {
  if (!window.watch) return;
  note("call", watch.delivery.call);
  note("model", watch.receiver.models.length);
  if (times.shown === undefined) times.bytes = watch.bytes;
  note("shown", watch.shown);
}, 5);
"""


def main(arguments: Sequence[str]) -> None:
    options = _parser().parse_args(arguments)
    if options.page:
        print(json.dumps(_page_times(Path(options.page), options.after)), flush=True)
        return
    if reason := obstacle():
        raise UserError(f"no wire can be made here: {reason}")
    if find_browser() is None:
        raise UserError("no Chromium is installed")
    names = ("the first", f"one after {options.after:g} s")
    rows: list[list[Cell]] = [
        [name, *(times[key] for key in ("call", "model", "shown")), times["bytes"] / 1000]
        for name, times in zip(names, _measured(options), strict=True)
    ]
    print(table(HEADER, rows))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clip", nargs="?", default="", help="a video file")
    parser.add_argument("--rate", type=float, default=8000.0, metavar="BPS")
    parser.add_argument("--delay", type=float, default=50.0, metavar="MS", help="one way")
    parser.add_argument("--startup", type=float, metavar="BPS", help="the caller's startup bitrate")
    parser.add_argument("--after", type=float, default=5.0, metavar="S")
    parser.add_argument("--page", help=argparse.SUPPRESS)  # the part that runs at the relay
    return parser


def _measured(options: argparse.Namespace) -> list[dict[str, float]]:
    """The times of both pages."""
    relay = [*PROGRAM, "relay", "--listen", ENDPOINT, "--watch", str(WATCH_PORT)]
    caller = [*PROGRAM, "encode", options.clip, "--live", "--pace", "--insecure", "-q", "-v"]
    caller += ["--connect", ENDPOINT, "--call", CALL, "--wait", str(READY_S + LIMIT_S)]
    if options.startup:
        caller += ["--startup-bitrate", str(options.startup)]
    faults = Faults(rate_bps=options.rate, delay_ms=options.delay)
    with tempfile.TemporaryDirectory() as name, BadWire((RELAY, CALLER), faults) as wire:
        folder = Path(name)
        logs = [folder / each for each in ("relay", "caller", "page")]
        with open(logs[0], "wb") as to_relay, open(logs[1], "wb") as to_caller:
            wire.hosts[0].run(relay, to_relay)
            _await(lambda: b"watch" in logs[0].read_bytes(), BEGIN_S)
            wire.hosts[1].run(caller, to_caller)
            _await(lambda: b"warmed up" in logs[1].read_bytes(), READY_S)
        page = [sys.executable, "-m", "benchmarks", "first_picture", "--page", name]
        with open(logs[2], "wb") as output:
            browser = wire.hosts[0].run([*page, "--after", str(options.after)], output)
            browser.wait(3 * LIMIT_S)
        lines = logs[2].read_text().splitlines()
        if not lines or not lines[-1].startswith("["):
            said = " ".join(log.read_text()[-300:] for log in logs)
            raise UserError(f"the page has shown nothing: {said}")
        times: list[dict[str, float]] = json.loads(lines[-1])
        return times


def _await(condition: Callable[[], bool], limit_s: float) -> None:
    if not holds_within(condition, limit_s):
        raise UserError(f"relay or caller did not begin within {limit_s:g} s")


def _page_times(folder: Path, after_s: float) -> list[Any]:
    program = find_browser()
    assert program is not None
    with Browser(program, folder / "profile", 800, 700, *SOFTWARE_GL) as browser:
        first = _opened(browser)
        time.sleep(after_s)
        with browser.tab("about:blank"):
            return [first, _opened(browser)]


def _opened(browser: Browser) -> Any:
    browser.call("Page.enable")
    browser.call("Page.addScriptToEvaluateOnNewDocument", source=TIMES)
    browser.call("Page.navigate", url=PAGE)
    browser.wait("window.times && times.shown", LIMIT_S)
    return browser.value("times")


if __name__ == "__main__":
    run(main)
