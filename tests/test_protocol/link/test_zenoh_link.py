"""Calls over real Zenoh sessions on loopback."""

import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from statistics import mode
from time import monotonic

import pytest
import zenoh
from packets import MODEL

from protocol.link.interface import LinkOptions, Reachability
from protocol.link.plain_protection import CHECKSUM_BYTES
from protocol.link.zenoh_link import ZENOH_OVERHEAD_BYTES, ZenohRouter, ZenohSink, ZenohSource
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    serialise,
)
from shared_model.errors import UserError

END = serialise(ControlPacket(0, ControlKind.END, 100))
MODEL_BYTES = serialise(MODEL)
WAIT_S = 20.0


def frame(number: int) -> bytes:
    """A frame packet that says which it is."""
    return serialise(FramePacket(number % 64, number.to_bytes(10, "big")))


def free_endpoint(scheme: str = "tcp") -> str:
    """A loopback endpoint on a port that the system has just called free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{scheme}/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as exits:
        yield exits


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


def listening(endpoint: str, lossless: bool = True) -> LinkOptions:
    return LinkOptions("test", listen=(endpoint,), lossless=lossless)


def connecting(endpoint: str, lossless: bool = True) -> LinkOptions:
    return LinkOptions("test", connect=(endpoint,), lossless=lossless)


def received(source: ZenohSource) -> bytes | None:
    """The next packet."""
    arrival = source.receive(WAIT_S)
    return None if arrival is None else arrival.data


def test_a_whole_call_arrives_in_order(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(ZenohSource(listening(endpoint)))
    sent = [MODEL_BYTES, *map(frame, range(600)), END]
    with ZenohSink(connecting(endpoint)) as sink:
        sink.wait_for_peer(WAIT_S)
        assert sink.peers == 1
        for packet in sent:
            sink.send(packet)
    assert list(source) == sent
    assert source.complete and source.ended and source.receive() is None


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_a_live_call_arrives_packet_by_packet(stack: ExitStack, scheme: str) -> None:
    endpoint = free_endpoint(scheme)
    sink = stack.enter_context(ZenohSink(listening(endpoint, lossless=False)))
    source = stack.enter_context(ZenohSource(connecting(endpoint, lossless=False)))
    sink.wait_for_peer(WAIT_S)
    for packet in [MODEL_BYTES, *map(frame, range(50)), END]:
        sink.send(packet)
        assert received(source) == packet


@pytest.mark.parametrize("listens", [True, False], ids=["listening", "connecting"])
def test_what_a_live_frame_costs_over_udp(stack: ExitStack, listens: bool) -> None:
    inner, outer = free_endpoint("udp"), free_endpoint("udp")
    if listens:
        sink = stack.enter_context(ZenohSink(listening(inner, lossless=False)))
        relay = stack.enter_context(MeasuringRelay(port_of(outer), port_of(inner)))
        source = stack.enter_context(ZenohSource(connecting(outer, lossless=False)))
        sizes, key = relay.sizes_out, 0
    else:
        source = stack.enter_context(ZenohSource(listening(inner, lossless=False)))
        relay = stack.enter_context(MeasuringRelay(port_of(outer), port_of(inner)))
        sink = stack.enter_context(ZenohSink(connecting(outer, lossless=False)))
        sizes, key = relay.sizes_in, 1 + len("d/test")
    sink.wait_for_peer(WAIT_S)
    sink.send(MODEL_BYTES)
    assert received(source) == MODEL_BYTES
    for number in range(60):
        sink.send(frame(number))
        assert received(source) == frame(number)
    checked = len(frame(0)) + CHECKSUM_BYTES
    assert mode(sizes) == checked + ZENOH_OVERHEAD_BYTES["udp"] + key


class MeasuringRelay:
    """Passes datagrams on between a port and another, and keeps their sizes."""

    def __init__(self, port: int, target: int) -> None:
        self.sizes_in, self.sizes_out = list[int](), list[int]()
        self._target = "127.0.0.1", target
        self._outside = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outside.bind(("127.0.0.1", port))
        # One for each client, as a translating router has.
        self._inside: dict[tuple[str, int], socket.socket] = {}
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._done.is_set():
            clients = {inside: client for client, inside in self._inside.items()}
            for ready in select.select([self._outside, *clients], [], [], 0.05)[0]:
                if ready is self._outside:
                    data, client = ready.recvfrom(65536)
                    self.sizes_in.append(len(data))
                    self._inside_of(client).sendto(data, self._target)
                else:
                    data = ready.recv(65536)
                    self.sizes_out.append(len(data))
                    self._outside.sendto(data, clients[ready])

    def _inside_of(self, client: tuple[str, int]) -> socket.socket:
        if client not in self._inside:
            self._inside[client] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        return self._inside[client]

    def __enter__(self) -> "MeasuringRelay":
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._done.set()
        self._thread.join()
        for each in (self._outside, *self._inside.values()):
            each.close()


def port_of(endpoint: str) -> int:
    """The port of an endpoint."""
    return int(endpoint.rsplit(":", 1)[1])


def test_two_ends_meet_at_a_router(stack: ExitStack, endpoint: str) -> None:
    config = zenoh.Config()
    for name, value in (
        ("mode", '"router"'),
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", f'["{endpoint}"]'),
    ):
        config.insert_json5(name, value)
    stack.enter_context(zenoh.open(config))
    source = stack.enter_context(ZenohSource(connecting(endpoint)))
    sent = [MODEL_BYTES, *map(frame, range(300)), END]
    with ZenohSink(connecting(endpoint)) as sink:
        sink.wait_for_peer(WAIT_S)
        for packet in sent:
            sink.send(packet)
    assert list(source) == sent


def test_who_joins_late_gets_the_model_first(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(ZenohSink(listening(endpoint, lossless=False)))
    layers = [serialise(replace(MODEL, version=n, version_count=2)) for n in range(2)]
    for packet in [*layers, frame(0), frame(1)]:
        sink.send(packet)
    source = stack.enter_context(ZenohSource(connecting(endpoint, lossless=False)))
    sink.wait_for_peer(WAIT_S)
    sink.send(frame(2))
    found = [received(source) for _ in range(3)]
    assert found[0] in layers
    assert sorted(found, key=str) == sorted([*layers, frame(2)], key=str)


def test_who_joins_late_gets_all_layers_sent_so_far(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(ZenohSink(listening(endpoint, lossless=False)))
    layers = [serialise(LayerPacket(0, number, b"piece")) for number in range(6)]
    first = serialise(replace(MODEL, progressive=True))
    for packet in [first, *layers[:4], frame(0)]:
        sink.send(packet)
    source = stack.enter_context(ZenohSource(connecting(endpoint, lossless=False)))
    sink.wait_for_peer(WAIT_S)
    for packet in [*layers[4:], frame(1)]:
        sink.send(packet)
    found = [received(source) for _ in range(8)]
    assert sorted(found, key=str) == sorted([first, *layers, frame(1)], key=str)


def test_who_joins_a_lossless_call_late_gets_all_of_it(stack: ExitStack, endpoint: str) -> None:
    sent = [MODEL_BYTES, *map(frame, range(100)), END]
    sink = stack.enter_context(ZenohSink(listening(endpoint)))
    for packet in sent:
        sink.send(packet)
    assert list(stack.enter_context(ZenohSource(connecting(endpoint)))) == sent


def test_receiving_times_out_and_carries_on(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(ZenohSource(listening(endpoint)))
    assert source.receive(timeout_s=0.001) is None
    assert not source.ended
    sink = stack.enter_context(ZenohSink(connecting(endpoint)))
    sink.wait_for_peer(WAIT_S)
    sink.send(MODEL_BYTES)
    assert received(source) == MODEL_BYTES
    assert source.receive(timeout_s=0) is None


def test_an_encoder_that_goes_without_a_word_ends_the_call(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(ZenohSource(listening(endpoint), leave_grace_s=0.01))
    with ZenohSink(connecting(endpoint)) as sink:
        sink.wait_for_peer(WAIT_S)
        sink.send(MODEL_BYTES)
    assert list(source) == [MODEL_BYTES]
    assert source.ended and not source.complete


def test_an_encoder_that_is_killed_and_started_again_goes_on_with_the_call(
    stack: ExitStack, endpoint: str
) -> None:
    source = stack.enter_context(ZenohSource(listening(endpoint), leave_grace_s=0.01))
    program = (
        "import sys; from protocol.link.interface import LinkOptions\n"
        "from protocol.link.zenoh_link import ZenohSink\n"
        "sink = ZenohSink(LinkOptions('test', connect=(sys.argv[1],)))\n"
        "sink.wait_for_peer(20); sink.send(bytes.fromhex(sys.argv[2])); sys.stdin.read()"
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


@pytest.mark.parametrize("waiting", ["connecting", "receiving"])
def test_ctrl_c_ends_the_wait_at_once(waiting: str, endpoint: str) -> None:
    program = (
        "import sys; from protocol.link.interface import LinkOptions\n"
        "from protocol.link.zenoh_link import ZenohSource\n"
        "try:\n"
        "    print('ready', flush=True)\n"
        "    options = LinkOptions('test', **{sys.argv[1]: (sys.argv[2],)}, connect_timeout_s=60)\n"
        "    with ZenohSource(options) as source: print('open', flush=True); source.receive()\n"
        "except KeyboardInterrupt: sys.exit(130)"
    )
    side = "connect" if waiting == "connecting" else "listen"
    child = subprocess.Popen(
        [sys.executable, "-c", program, side, endpoint], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    for word in ["ready"] if waiting == "connecting" else ["ready", "open"]:
        assert child.stdout.readline().strip() == word
    os.kill(child.pid, signal.SIGINT)
    assert child.wait(WAIT_S) == 130
    child.stdout.close()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    "wait",
    [
        "ZenohSource(LinkOptions('test', connect=(endpoint,), connect_timeout_s=60), say)",
        "ZenohSource(LinkOptions('test', listen=(endpoint,)), say).receive()",
        "ZenohSink(LinkOptions('test', listen=(endpoint,)), say).wait_for_peer(60)",
    ],
    ids=["connecting", "receiving", "waiting"],
)
def test_ctrl_c_ends_the_wait_whichever_thread_takes_it(wait: str, endpoint: str) -> None:
    program = (
        "import os, signal, sys, threading\n"
        "from protocol.link.interface import LinkOptions\n"
        "from protocol.link.zenoh_link import ZenohSink, ZenohSource\n"
        "def interrupt():\n"
        "    asleep = 0\n"
        "    while asleep < 200:\n"
        "        with open(f'/proc/self/task/{os.getpid()}/stat') as file: state = file.read()\n"
        "        asleep = asleep + 1 if state.split()[2] == 'S' else 0\n"
        "    signal.pthread_kill(threading.get_ident(), signal.SIGINT)\n"
        "def say(line): threading.Thread(target=interrupt).start()\n"
        "endpoint = sys.argv[1]\n"
        f"try: {wait}\n"
        "except KeyboardInterrupt: sys.exit(130)"
    )
    command = [sys.executable, "-c", program, endpoint]
    assert subprocess.run(command, check=False, timeout=WAIT_S).returncode == 130


@pytest.mark.parametrize("end", ["ZenohSource", "ZenohSink"])
def test_a_program_ends_whenever_its_link_is_interrupted_while_it_opens(end: str) -> None:
    program = (
        "import sys; from signal import ITIMER_REAL, SIGALRM, setitimer, signal\n"
        "import protocol.link.zenoh_link as link\n"
        "def interrupt(*_): raise KeyboardInterrupt\n"
        "signal(SIGALRM, interrupt)\n"
        "options, opened = link.LinkOptions('test', listen=('tcp/127.0.0.1:0',)), 0\n"
        "for number in range(1, 10_000):\n"
        "    try:\n"
        "        setitimer(ITIMER_REAL, number * 1e-5)\n"
        "        with getattr(link, sys.argv[1])(options): setitimer(ITIMER_REAL, 0)\n"
        "        opened += 1\n"
        "    except KeyboardInterrupt: pass\n"
        "    if opened == 100: sys.exit(7)\n"
    )
    child = subprocess.run([sys.executable, "-c", program, end], check=False, timeout=WAIT_S)
    assert child.returncode == 7


def test_an_encoder_that_comes_back_goes_on_with_the_call(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(ZenohSource(listening(endpoint), leave_grace_s=WAIT_S))
    with ZenohSink(connecting(endpoint)) as first:
        first.wait_for_peer(WAIT_S)
        first.send(MODEL_BYTES)
        first.send(frame(0))
    with ZenohSink(connecting(endpoint)) as second:
        second.wait_for_peer(WAIT_S)
        second.send(MODEL_BYTES)
        second.send(frame(1))
        second.send(END)
    found = [source.receive(WAIT_S) for _ in range(5)]
    assert source.complete
    came = [(each.session, each.number, each.data) for each in found if each is not None]
    first_session = [(0, 0, MODEL_BYTES), (0, 0, frame(0))]
    assert came == [*first_session, (1, 0, MODEL_BYTES), (1, 0, frame(1)), (1, 1, END)]


def test_the_encoder_sees_decoders_come_and_go(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(ZenohSink(listening(endpoint)))
    with pytest.raises(UserError, match="no decoder came") as caught:
        sink.wait_for_peer(0.01)
    assert caught.value.exit_code == 4 and sink.peers == 0
    with ZenohSource(connecting(endpoint)):
        sink.wait_for_peer(WAIT_S)
        assert sink.peers == 1
    gone = threading.Event()
    while sink.peers:
        assert not gone.wait(0.001)


def test_the_encoder_says_when_nobody_listens_any_more(stack: ExitStack, endpoint: str) -> None:
    said: list[str] = []
    sink = stack.enter_context(ZenohSink(listening(endpoint), said.append))
    assert said.pop() == f"listening on {endpoint} for a decoder of call 'test'"
    sink.send(MODEL_BYTES)
    assert sink.reachability is Reachability.NO_PEER and said == []
    with ZenohSource(connecting(endpoint)):
        sink.wait_for_peer(WAIT_S)
        send_until(sink, Reachability.HAS_PEER)
        assert said == []
    send_until(sink, Reachability.NO_PEER)
    assert said == ["nobody listens any more; sending on"]
    source = stack.enter_context(ZenohSource(connecting(endpoint)))
    assert received(source) == MODEL_BYTES
    send_until(sink, Reachability.HAS_PEER)
    assert said[1:] == ["somebody listens again"]


def test_a_link_that_breaks_is_known_and_made_again(stack: ExitStack, endpoint: str) -> None:
    said: list[str] = []
    with ZenohRouter((endpoint,)):
        sink = stack.enter_context(ZenohSink(connecting(endpoint), said.append))
        assert said.pop() == f"connecting to {endpoint} for a decoder of call 'test'"
        with ZenohSource(connecting(endpoint)):
            sink.wait_for_peer(WAIT_S)
            send_until(sink, Reachability.HAS_PEER)
        send_until(sink, Reachability.NO_PEER)
    send_until(sink, Reachability.NO_LINK)
    stack.enter_context(ZenohRouter((endpoint,)))
    send_until(sink, Reachability.NO_PEER)
    said.clear()
    source = stack.enter_context(ZenohSource(connecting(endpoint), said.append))
    assert said == [f"connecting to {endpoint} for an encoder of call 'test'"]
    send_until(sink, Reachability.HAS_PEER)
    sink.send(MODEL_BYTES)
    assert received(source) == MODEL_BYTES


def send_until(sink: ZenohSink, reach: Reachability) -> None:
    """Send END packets until one reaches so far."""
    pause, deadline = threading.Event(), monotonic() + WAIT_S
    sink.send(END)
    while sink.reachability is not reach:
        assert monotonic() < deadline, sink.reachability
        pause.wait(0.005)
        sink.send(END)


def test_a_call_has_one_encoder(stack: ExitStack, endpoint: str) -> None:
    stack.enter_context(ZenohSource(listening(endpoint)))
    first = stack.enter_context(ZenohSink(connecting(endpoint)))
    first.wait_for_peer(WAIT_S)
    second = stack.enter_context(ZenohSink(connecting(endpoint)))
    with pytest.raises(UserError, match="call 'test' has an encoder already") as caught:
        second.wait_for_peer(WAIT_S)
    assert caught.value.exit_code == 4 and second.peers == 0 and first.peers == 1


def test_a_port_in_use_is_said_in_one_line() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        endpoint = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
        with pytest.raises(UserError, match="port is in use") as caught:
            ZenohSource(listening(endpoint))
    assert caught.value.exit_code == 4


def test_an_address_of_someone_else_is_said_in_one_line() -> None:
    with pytest.raises(UserError, match=r"cannot listen on tcp/192\.0\.2\.1:7447: ") as caught:
        ZenohSource(listening("tcp/192.0.2.1:7447"))
    assert caught.value.exit_code == 4
    assert ".rs" not in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_nobody_listening_is_said_within_the_timeout(scheme: str) -> None:
    where = free_endpoint(scheme)
    with pytest.raises(UserError) as caught:
        ZenohSink(replace(connecting(where), connect_timeout_s=0.2))
    assert str(caught.value) == f"cannot reach {where} within 0.2 s: nobody listens there"
    assert caught.value.exit_code == 4


def test_a_name_that_is_not_known_is_said_at_once() -> None:
    with pytest.raises(UserError) as caught:
        ZenohSource(connecting("nobody.invalid:7447"))
    assert str(caught.value) == "cannot reach nobody.invalid:7447: its name is not known"
    assert caught.value.exit_code == 4


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_who_is_there_for_another_call_is_named(stack: ExitStack, scheme: str) -> None:
    where, said = free_endpoint(scheme), list[str]()
    stack.enter_context(ZenohSource(replace(listening(where), call="other")))
    sink = stack.enter_context(ZenohSink(connecting(where), said.append))
    with pytest.raises(UserError, match="somebody is there, but for call 'other'") as caught:
        sink.wait_for_peer(1.5)
    assert caught.value.exit_code == 4
    assert said[1:] == ["somebody is there, but for call 'other'"]


def test_nobody_there_yet_is_not_somebody_for_another_call(stack: ExitStack, endpoint: str) -> None:
    stack.enter_context(ZenohRouter((endpoint,)))
    sink = stack.enter_context(ZenohSink(connecting(endpoint)))
    with pytest.raises(UserError, match=r"^no decoder came within 0\.8 s$"):
        sink.wait_for_peer(0.8)


def test_sending_after_closing_is_a_failed_link(endpoint: str) -> None:
    sink = ZenohSink(listening(endpoint))
    sink.close()
    sink.close()
    with pytest.raises(UserError, match="link has failed") as caught:
        sink.send(END)
    assert caught.value.exit_code == 4
