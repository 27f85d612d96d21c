"""Calls on the local network."""

import os
import socket
import sys
import time
from pathlib import Path
from queue import SimpleQueue

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import LIMIT_S, until

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import BadWire, Faults
from protocol.discovery import (
    ANSWERS_PER_S,
    GROUP,
    PORT,
    QUESTION_BYTES,
    CallAnnouncer,
    CallWatch,
    FoundCall,
    find_calls,
    parse_answer,
    parse_question,
    serialise_answer,
    serialise_question,
)
from protocol.endpoint import OwnAddress
from protocol.errors import ProtocolError

NUMBER = bytes(range(8))
ANNA = FoundCall("anna", "192.0.2.7", 7447, True, False)
names = st.from_regex(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,39}", fullmatch=True)


@given(names, st.integers(1, 65535), st.booleans(), st.booleans())
def test_answers_come_back(call: str, port: int, is_encoder: bool, needs: bool) -> None:
    found = FoundCall(call, "192.0.2.7", port, is_encoder, needs)
    answer = serialise_answer(NUMBER, found)
    assert parse_answer(answer, NUMBER, "192.0.2.7") == found
    assert found.address == f"192.0.2.7:{port}"


def test_nobody_is_made_to_send_more_than_was_asked_for() -> None:
    question = serialise_question(NUMBER)
    assert parse_question(question) == NUMBER
    assert len(question) == QUESTION_BYTES
    longest = serialise_answer(NUMBER, FoundCall(63 * "a", "h", 1, True, True))
    assert len(longest) <= QUESTION_BYTES
    assert parse_answer(longest, NUMBER, "h").call == 63 * "a"
    with pytest.raises(ProtocolError, match="names no call"):
        parse_answer(longest + b"a", NUMBER, "h")
    for wrong in (question[:-1], question + b"\0", b"", b"RZQ1" + NUMBER):
        assert parse_question(wrong) is None


def test_answers_to_others_and_garbage_are_refused() -> None:
    answer = serialise_answer(NUMBER, ANNA)
    for wrong in (
        b"",
        answer[:15],
        answer[:12] + b"\x07" + answer[13:],
        answer[:13] + b"\0\0" + answer[15:],
        answer[:15] + b"a/b",
        answer[:15] + b"\xff",
        answer + 200 * b"a",
    ):
        with pytest.raises(ProtocolError):
            parse_answer(wrong, NUMBER, "h")
    with pytest.raises(ProtocolError):
        parse_answer(answer, bytes(8), "h")


def reaches_itself() -> bool:
    """Whether what is sent to the group over loopback comes back."""
    own = socket.inet_aton("127.0.0.1")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as group:
        try:
            group.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            group.bind((GROUP, PORT))
            group.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + own
            )
            group.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
            group.sendto(b"itself", (GROUP, PORT))
            group.settimeout(1)
            while group.recv(QUESTION_BYTES) != b"itself":
                pass
        except OSError:
            return False
    return True


has_multicast = pytest.mark.skipif(not reaches_itself(), reason="loopback has no multicast here")


@given(st.binary(max_size=40))
def test_any_bytes_are_an_answer_or_none(data: bytes) -> None:
    try:
        parse_answer(b"RZA1" + NUMBER + data, NUMBER, "h")
    except ProtocolError:
        return


PROGRAM = """
import sys
from itertools import islice
from protocol.discovery import CallAnnouncer, FoundCall, find_calls
kind, *arguments = sys.argv[1:]
if kind == "find":
    # As soon as so many have answered: this may take long on a busy host.
    for found in islice(find_calls(600), int(arguments[0])):
        print(found.call, found.address, found.is_encoder, found.needs_invitation, flush=True)
else:
    with CallAnnouncer(FoundCall(arguments[0], "", 7447, kind == "encoder", kind == "encoder")):
        print("ready", flush=True)
        sys.stdin.read() or __import__("signal").pause()
"""


@pytest.mark.skipif(obstacle() is not None, reason=str(obstacle()))
def test_calls_are_found_on_a_local_network(tmp_path: Path) -> None:
    root = str(Path(__file__).resolve().parents[2])
    environment = os.environ | {"PYTHONPATH": root}
    command = [sys.executable, "-c", PROGRAM]
    logs = [tmp_path / name for name in ("1", "2", "3")]
    addresses = [f"10.77.0.{number}" for number in (1, 2, 3)]
    with BadWire(addresses, Faults(), 1) as wire:
        asked = (["encoder", "anna"], ["decoder", "bert"], ["find", "2"])
        processes = []
        for host, log, arguments in zip(wire.hosts, logs, asked, strict=True):
            with log.open("wb") as output:
                process = host.run([*command, *arguments], output, environment)
            processes.append(process)
            if arguments[0] != "find":
                until(lambda log=log: b"ready" in log.read_bytes())  # type: ignore[misc]
        assert processes[2].wait(LIMIT_S) == 0, logs[2].read_text()
        for process in processes[:2]:
            process.kill()
            process.wait()
    assert sorted(logs[2].read_text().splitlines()) == [
        "anna 10.77.0.1:7447 True True",
        "bert 10.77.0.2:7447 False False",
    ]


@has_multicast
def test_a_flood_of_questions_gets_few_answers() -> None:
    with (
        CallAnnouncer(ANNA, "127.0.0.1"),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking,
    ):
        found = next(find_calls(LIMIT_S, "127.0.0.1"))
        assert found == FoundCall("anna", "127.0.0.1", 7447, True, False)
        asking.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        begun = time.monotonic()
        for _ in range(500):
            asking.sendto(serialise_question(NUMBER), (GROUP, PORT))
        asking.settimeout(LIMIT_S)
        answers = len([asking.recv(QUESTION_BYTES)])
        asking.settimeout(0.3)
        while True:
            try:
                asking.recv(QUESTION_BYTES)
            except TimeoutError:
                break
            answers += 1
        assert answers <= ANSWERS_PER_S * (1 + time.monotonic() - begun)


def test_a_closed_announcer_is_silent() -> None:
    announcer = CallAnnouncer(ANNA, "127.0.0.1")
    announcer.close()
    announcer.close()
    assert list(find_calls(0.1, "127.0.0.1")) == []


@has_multicast
def test_a_call_that_answers_twice_is_found_once() -> None:
    found = list[FoundCall]()
    with CallAnnouncer(ANNA, "127.0.0.1"), CallAnnouncer(ANNA, "127.0.0.1"):
        until(lambda: bool(found), lambda: found.extend(find_calls(0.3, "127.0.0.1")))
    assert found == [FoundCall("anna", "127.0.0.1", 7447, True, False)]


def test_without_multicast_nobody_answers() -> None:
    # Of no interface of this host (RFC 5737).
    with CallAnnouncer(ANNA, "203.0.113.1"):
        assert list(find_calls(0.1, "127.0.0.1")) == []


class ChangingAddress(OwnAddress):
    """One that a test gives an address."""

    address: str | None = None

    @property
    def now(self) -> str | None:
        return self.address


@has_multicast
def test_who_has_another_address_says_so_to_those_who_wait_for_that_end() -> None:
    told, others = SimpleQueue[FoundCall](), SimpleQueue[FoundCall]()
    watch, *other_watches = (
        CallWatch(call, is_encoder, on_notice, "127.0.0.1")
        for call, is_encoder, on_notice in (
            ("anna", True, told.put),
            ("anna", False, others.put),
            ("bert", True, others.put),
        )
    )
    own = ChangingAddress("0.0.0.0")
    with CallAnnouncer(ANNA, "127.0.0.1", own):
        own.address = "127.0.0.1"
        found = told.get(timeout=LIMIT_S)
    for each in (watch, watch, *other_watches):
        each.close()
    assert (found.call, found.port, found.is_encoder) == ("anna", 7447, True) and others.empty()


def test_without_multicast_nobody_is_watched() -> None:
    CallWatch("anna", True, lambda found: None, "203.0.113.1").close()
