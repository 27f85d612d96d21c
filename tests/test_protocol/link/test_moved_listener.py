"""The listening end's host gets another address in the middle of a call."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import until

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults, Host

pytestmark = pytest.mark.skipif(obstacle() is not None, reason=f"no wire: {obstacle()}")

OLD, NEW, OTHER = "10.79.0.1", "10.79.0.9", "10.79.0.2"
# The name that the file `names` gives an address.
NAME = "phone.test"
COMMON = f"""
import socket, sys
from contextlib import nullcontext
from pathlib import Path
from protocol.discovery import CallAnnouncer, FoundCall
from protocol.endpoint import OwnAddress, parse_endpoint
from protocol.link.interface import LinkOptions
from protocol.link.carriers import open_link_sink, open_link_source
from protocol.security.link_security import LinkSecurity
known = socket.getaddrinfo
def look_up(host, *place, **hints):
    return known(Path(sys.argv[2]).read_text() if host == "{NAME}" else host, *place, **hints)
socket.getaddrinfo = look_up
where, names, follows = sys.argv[1:]
security = LinkSecurity(bytes(16)) if follows == "with a key" else LinkSecurity()
"""
RECEIVE = (
    COMMON
    + """
found, host = FoundCall("anna", "", 7447, False, True), parse_endpoint(where).host
says = follows == "with a key"
announcer = CallAnnouncer(found, None, OwnAddress(host)) if says else nullcontext()
with announcer, open_link_source(LinkOptions("anna", listen=(where,), security=security)) as source:
    while (arrival := source.receive()) is not None: print(arrival.number, flush=True)
"""
)
SEND = (
    COMMON
    + f"""
import time
sys.path.insert(0, {str(Path(__file__).resolve().parents[2])!r})
from links import MODEL_BYTES, frame
options = LinkOptions("anna", connect=(where,), connect_timeout_s=600, security=security)
with open_link_sink(options) as sink:
    sink.wait_for_peer(600)
    sink.send(MODEL_BYTES)
    for number in range(10_000):
        sink.send(frame(number))
        time.sleep(0.1)
"""
)


def start(host: Host, log: Path, program: str, *arguments: str | Path) -> "subprocess.Popen[bytes]":
    root = Path(__file__).resolve().parents[3]
    with log.open("wb") as output:
        command = [sys.executable, "-c", program, *map(str, arguments)]
        return host.run(command, output, os.environ | {"PYTHONPATH": str(root)})


def came(log: Path) -> int:
    """The number of the newest packet that has come."""
    numbers = [line for line in log.read_text().splitlines() if line.isdigit()]
    return int(numbers[-1]) if numbers else -1


def wait_beyond(log: Path, number: int, receiver: "subprocess.Popen[bytes]") -> None:
    def still_runs() -> None:
        assert receiver.poll() is None, log.read_text()

    until(lambda: came(log) > number, still_runs)


@pytest.mark.parametrize(
    ("listening", "connecting", "follows"),
    [
        (":7447", f"{OLD}:7447", "with a key"),
        (f"{OLD}:7447", f"{OLD}:7447", "with a key"),
        (":7447", f"{NAME}:7447", "by its name"),
    ],
    ids=["announced", "listening on one address", "by its name"],
)
def test_a_call_goes_on_when_the_listening_end_has_another_address(
    listening: str, connecting: str, follows: str, tmp_path: Path
) -> None:
    names, receiving, sending = (tmp_path / name for name in ("names", "receiving", "sending"))
    names.write_text(OLD)
    with BadWire([OLD, OTHER], Faults()) as wire:
        receiver = start(wire.hosts[0], receiving, RECEIVE, listening, names, follows)
        start(wire.hosts[1], sending, SEND, connecting, names, follows)
        wait_beyond(receiving, 2, receiver)
        wire.hosts[0].readdress(NEW)
        names.write_text(NEW)
        wait_beyond(receiving, came(receiving) + 3, receiver)
