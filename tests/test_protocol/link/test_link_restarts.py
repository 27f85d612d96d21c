"""Ends that leave, are killed, come back, and are there twice; links that break."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack
from time import monotonic

import pytest
from links import (
    END,
    MODEL_BYTES,
    WAIT_S,
    connecting,
    frame,
    listening,
    received,
)

from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.interface import Reachability
from protocol.link.link_sink import LinkSink
from protocol.packets import ControlKind, ControlPacket, serialise
from protocol.relay.zenoh_relay import Relay, RelayOptions
from shared_model.errors import UserError

NEWS = serialise(ControlPacket(0, ControlKind.FACE_FOUND, 0))


def test_an_encoder_that_is_killed_and_started_again_goes_on_with_the_call(
    stack: ExitStack, endpoint: str
) -> None:
    source = stack.enter_context(open_link_source(listening(endpoint)))
    program = (
        "import sys; from protocol.link.interface import LinkOptions\n"
        "from protocol.link.carriers import open_link_sink\n"
        "options = LinkOptions('test', connect=(sys.argv[1],), connect_timeout_s=600)\n"
        "sink = open_link_sink(options)\n"
        "sink.wait_for_peer(600); sink.send(bytes.fromhex(sys.argv[2])); sys.stdin.read()"
    )
    command = [sys.executable, "-c", program, endpoint, MODEL_BYTES.hex()]
    for session in range(2):
        child = subprocess.Popen(command, stdin=subprocess.PIPE)
        arrival = source.receive(WAIT_S)
        assert arrival is not None
        assert (arrival.data, arrival.session) == (MODEL_BYTES, session)
        os.kill(child.pid, signal.SIGKILL)
        child.communicate()
        assert source.receive(0.5) is None and not source.ended


def test_an_encoder_that_comes_back_goes_on_with_the_call(
    stack: ExitStack, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("protocol.link.link_source.LEAVE_GRACE_S", WAIT_S)
    source = stack.enter_context(open_link_source(listening(endpoint)))
    with open_link_sink(connecting(endpoint)) as first:
        first.wait_for_peer(WAIT_S)
        first.send(MODEL_BYTES)
        first.send(frame(0))
    with open_link_sink(connecting(endpoint)) as second:
        second.wait_for_peer(WAIT_S)
        second.send(MODEL_BYTES)
        second.send(frame(0))
        second.send(END)
    found = [source.receive(WAIT_S) for _ in range(5)]
    assert source.complete
    came = [(each.session, each.number, each.data) for each in found if each is not None]
    first_session = [(0, 0, MODEL_BYTES), (0, 0, frame(0))]
    assert came == [*first_session, (1, 0, MODEL_BYTES), (1, 0, frame(0)), (1, 1, END)]


def test_the_encoder_sees_decoders_come_and_go(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(open_link_sink(listening(endpoint)))
    with pytest.raises(UserError, match="no decoder came") as caught:
        sink.wait_for_peer(0.01)
    assert caught.value.exit_code == 4 and sink.peers == 0
    with open_link_source(connecting(endpoint)):
        sink.wait_for_peer(WAIT_S)
        assert sink.peers == 1 and sink.quality.loss == 0
    gone = threading.Event()
    while sink.peers:
        assert not gone.wait(0.001)


def test_the_encoder_says_when_nobody_listens_any_more(stack: ExitStack, endpoint: str) -> None:
    said: list[str] = []
    sink = stack.enter_context(open_link_sink(listening(endpoint), said.append))
    assert said.pop() == f"listening on {endpoint} for a decoder of call 'test'"
    sink.send(MODEL_BYTES)
    assert sink.reachability is Reachability.NO_PEER and said == []
    with open_link_source(connecting(endpoint)):
        sink.wait_for_peer(WAIT_S)
        send_until(sink, Reachability.HAS_PEER)
        assert said == []
    send_until(sink, Reachability.NO_PEER)
    assert said == ["nobody listens any more; sending on"]
    source = stack.enter_context(open_link_source(connecting(endpoint)))
    assert received(source) == MODEL_BYTES
    send_until(sink, Reachability.HAS_PEER)
    assert said[1:] == ["somebody listens again"]


def test_a_link_that_breaks_is_known_and_made_again(stack: ExitStack, endpoint: str) -> None:
    said: list[str] = []
    with Relay(RelayOptions((endpoint,))):
        sink = stack.enter_context(open_link_sink(connecting(endpoint), said.append))
        assert said.pop() == f"connecting to {endpoint} for a decoder of call 'test'"
        with open_link_source(connecting(endpoint)):
            sink.wait_for_peer(WAIT_S)
            send_until(sink, Reachability.HAS_PEER)
        send_until(sink, Reachability.NO_PEER)
    send_until(sink, Reachability.NO_LINK)
    stack.enter_context(Relay(RelayOptions((endpoint,))))
    send_until(sink, Reachability.NO_PEER)
    said.clear()
    source = stack.enter_context(open_link_source(connecting(endpoint), said.append))
    assert said == [f"connecting to {endpoint} for an encoder of call 'test'"]
    send_until(sink, Reachability.HAS_PEER)
    sink.send(MODEL_BYTES)
    while (packet := received(source)) != MODEL_BYTES:
        assert packet == NEWS


def send_until(sink: LinkSink, reach: Reachability) -> None:
    """Send packets until one reaches so far."""
    pause, deadline = threading.Event(), monotonic() + WAIT_S
    sink.send(NEWS)
    while sink.reachability is not reach:
        assert monotonic() < deadline, sink.reachability
        pause.wait(0.005)
        sink.send(NEWS)


def test_a_call_has_one_encoder(stack: ExitStack, endpoint: str) -> None:
    stack.enter_context(open_link_source(listening(endpoint)))
    first = stack.enter_context(open_link_sink(connecting(endpoint)))
    first.wait_for_peer(WAIT_S)
    second = stack.enter_context(open_link_sink(connecting(endpoint)))
    with pytest.raises(UserError, match="call 'test' has an encoder already") as caught:
        second.wait_for_peer(WAIT_S)
    assert caught.value.exit_code == 4 and second.peers == 0 and first.peers == 1


def test_two_decoders_do_not_meet(stack: ExitStack, endpoint: str) -> None:
    said: list[str] = []
    stack.enter_context(open_link_source(listening(endpoint)))
    second = stack.enter_context(open_link_source(connecting(endpoint), said.append))
    deadline = monotonic() + WAIT_S
    while len(said) < 2:
        assert second.receive(0.05) is None and monotonic() < deadline
    assert said[1:] == ["another decoder of the call is there"]
