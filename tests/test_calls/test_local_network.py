"""Calls on a local network: who listens is found by the call's name, without an address."""

import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT
from processes import LIMIT_S, until

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults

THESIS = ("--profile", "thesis", "--max-frames", "8")
WAIT = ("--wait", str(LIMIT_S))

pytestmark = pytest.mark.skipif(obstacle() is not None, reason=str(obstacle()))


class Network:
    """Hosts 10.78.0.1 to 10.78.0.3, and what the programs on them have printed."""

    def __init__(self, wire: BadWire, folder: Path, stack: ExitStack) -> None:
        self._wire, self._folder, self._stack = wire, folder, stack
        self._logs = dict[int, Path]()

    def start(self, host: int, *arguments: str | Path) -> "subprocess.Popen[bytes]":
        self._logs[host] = self._folder / f"{host}.log"
        with self._logs[host].open("wb") as output:
            command = [*PROGRAM, *map(str, arguments)]
            environment = os.environ | {"PYTHONPATH": str(ROOT)}
            process = self._wire.hosts[host - 1].run(command, output, environment)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    def printed(self, host: int) -> str:
        return self._logs[host].read_text()

    def wait_for(self, host: int, text: str) -> None:
        until(lambda: text in self.printed(host))


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    addresses = [f"10.78.0.{number}" for number in (1, 2, 3)]
    with BadWire(addresses, Faults()) as wire, ExitStack() as stack:
        yield Network(wire, tmp_path, stack)


def test_a_decoder_finds_the_encoder_of_a_call_by_its_name(
    network: Network, carphone: Path
) -> None:
    places = ["--listen", ":7447", "--call", "anna", "--insecure"]
    network.start(1, "encode", carphone, *places, *THESIS, *WAIT)
    network.wait_for(1, "listening")
    network.start(2, "decode", "--call", "anna", "--insecure", "--timeout", str(LIMIT_S))
    listed = list[str]()

    def list_calls() -> None:
        assert network.start(3, "calls", "--wait", "1").wait(LIMIT_S) == 0
        listed.append(network.printed(3))

    # A busy host answers later than within a second.
    until(lambda: bool(listed) and listed[-1] != "no call\n", list_calls)
    assert listed[-1].split() == ["anna", "10.78.0.1:7447", "an", "encoder", "waits"]
    network.wait_for(2, "connecting to 10.78.0.1:7447 for an encoder of call 'anna'")
    assert "looking for call 'anna' on the local network" in network.printed(2)


def test_two_hosts_and_one_invitation(network: Network, carphone: Path, tmp_path: Path) -> None:
    decoder = network.start(1, "decode", "--listen", ":7447", "-o", tmp_path / "out.mkv")
    network.wait_for(1, "listening")
    (invitation,) = re.findall(r"risorius://10\.78\.0\.1:7447/\S+", network.printed(1))
    name = invitation.partition("#")[0].rpartition("/")[2]
    # Who only knows its name or its address is not let in.
    intruder = network.start(3, "encode", carphone, "--call", name, *THESIS, *WAIT)
    assert intruder.wait(LIMIT_S) == 2 and "needs an invitation" in network.printed(3)
    encoder = network.start(2, "encode", carphone, "--invite", invitation, *THESIS, *WAIT)
    assert encoder.wait(LIMIT_S) == 0, network.printed(2)
    assert decoder.wait(LIMIT_S) == 0, network.printed(1)
    assert "8 frames of 176x144" in network.printed(1)


def test_who_finds_no_call_is_told_which_there_are(network: Network, carphone: Path) -> None:
    network.start(1, "decode", "--listen", "10.78.0.1:7447", "--call", "anna")
    network.wait_for(1, "listening")
    alone = network.start(3, "calls", "--wait", "0")
    said = list[str]()

    def look_for_bert() -> None:
        line = ("encode", carphone, "--call", "bert", "--wait", "1", *THESIS)
        assert network.start(2, *line).wait(LIMIT_S) == 4
        said.append(network.printed(2))

    # A busy host answers later than within a second.
    until(lambda: bool(said) and "; there is" in said[-1], look_for_bert)
    expected = "a decoder of call 'bert' does not listen on the local network; there is a decoder"
    assert f"{expected} of call 'anna'" in said[-1]
    assert alone.wait(LIMIT_S) == 0 and network.printed(3) == "no call\n"
