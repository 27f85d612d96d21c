"""Calls on a local network: who listens is found by the call's name, without an address."""

import os
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT
from processes import LIMIT_S

from loopback.bad_wire import BadWire, Faults
from loopback.network_namespace import obstacle

THESIS = ("--profile", "thesis", "--max-frames", "8")

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
        deadline = time.monotonic() + LIMIT_S
        while text not in self.printed(host):
            assert time.monotonic() < deadline, self.printed(host)
            time.sleep(0.02)


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    addresses = [f"10.78.0.{number}" for number in (1, 2, 3)]
    with BadWire(addresses, Faults()) as wire, ExitStack() as stack:
        yield Network(wire, tmp_path, stack)


def test_a_decoder_finds_the_encoder_of_a_call_by_its_name(
    network: Network, carphone: Path
) -> None:
    places = ["--listen", ":7447", "--call", "anna", "--insecure"]
    network.start(1, "encode", carphone, *places, *THESIS)
    network.wait_for(1, "listening")
    listing = network.start(3, "calls", "--wait", "1")
    network.start(2, "decode", "--call", "anna", "--insecure")
    assert listing.wait(LIMIT_S) == 0
    assert network.printed(3).split() == ["anna", "10.78.0.1:7447", "an", "encoder", "waits"]
    network.wait_for(2, "connecting to 10.78.0.1:7447 for an encoder of call 'anna'")
    assert "looking for call 'anna' on the local network" in network.printed(2)


def test_two_hosts_and_one_invitation(network: Network, carphone: Path, tmp_path: Path) -> None:
    decoder = network.start(1, "decode", "--listen", ":7447", "-o", tmp_path / "out.mkv")
    network.wait_for(1, "listening")
    (invitation,) = re.findall(r"risorius://10\.78\.0\.1:7447/\S+", network.printed(1))
    name = invitation.partition("#")[0].rpartition("/")[2]
    # Who only knows its name or its address is not let in.
    intruder = network.start(3, "encode", carphone, "--call", name, *THESIS)
    assert intruder.wait(LIMIT_S) == 2 and "needs an invitation" in network.printed(3)
    encoder = network.start(2, "encode", carphone, "--invite", invitation, *THESIS)
    assert encoder.wait(LIMIT_S) == 0, network.printed(2)
    assert decoder.wait(LIMIT_S) == 0, network.printed(1)
    assert "8 frames of 176x144" in network.printed(1)


def test_who_finds_no_call_is_told_which_there_are(network: Network, carphone: Path) -> None:
    network.start(1, "decode", "--listen", "10.78.0.1:7447", "--call", "anna")
    network.wait_for(1, "listening")
    encoder = network.start(2, "encode", carphone, "--call", "bert", "--wait", "1", *THESIS)
    alone = network.start(3, "calls", "--wait", "0")
    assert encoder.wait(LIMIT_S) == 4
    expected = "a decoder of call 'bert' does not listen on the local network; there is a decoder"
    assert f"{expected} of call 'anna'" in network.printed(2)
    assert alone.wait(LIMIT_S) == 0 and network.printed(3) == "no call\n"
