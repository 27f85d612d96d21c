"""Calls over real Zenoh sessions on loopback."""

import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace

import pytest
from links import END, MODEL_BYTES, WAIT_S, connecting, frame, free_endpoint, listening, received
from packets import MODEL

from protocol.link.carriers import open_link_sink, open_link_source
from protocol.packets import LayerPacket, serialise
from protocol.relay.zenoh_relay import Relay, RelayOptions


def test_a_whole_call_arrives_in_order(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(open_link_source(listening(endpoint)))
    sent = [MODEL_BYTES, *map(frame, range(600)), END]
    with open_link_sink(connecting(endpoint)) as sink:
        sink.wait_for_peer(WAIT_S)
        assert sink.peers == 1
        for packet in sent:
            sink.send(packet)
    assert list(source) == sent
    assert source.complete and source.ended and source.receive() is None


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_a_live_call_arrives_packet_by_packet(stack: ExitStack, scheme: str) -> None:
    endpoint = free_endpoint(scheme)
    sink = stack.enter_context(open_link_sink(listening(endpoint, lossless=False)))
    source = stack.enter_context(open_link_source(connecting(endpoint, lossless=False)))
    sink.wait_for_peer(WAIT_S)
    for packet in [MODEL_BYTES, *map(frame, range(50)), END]:
        sink.send(packet)
        assert received(source) == packet


def test_two_ends_meet_at_a_router(stack: ExitStack, endpoint: str) -> None:
    stack.enter_context(Relay(RelayOptions((endpoint,))))
    source = stack.enter_context(open_link_source(connecting(endpoint)))
    sent = [MODEL_BYTES, *map(frame, range(300)), END]
    with open_link_sink(connecting(endpoint)) as sink:
        sink.wait_for_peer(WAIT_S)
        for packet in sent:
            sink.send(packet)
    assert list(source) == sent


def test_who_joins_late_gets_the_model_first(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(open_link_sink(listening(endpoint, lossless=False)))
    layers = [serialise(replace(MODEL, version=n, version_count=2)) for n in range(2)]
    for packet in [*layers, frame(0), frame(1)]:
        sink.send(packet)
    source = stack.enter_context(open_link_source(connecting(endpoint, lossless=False)))
    sink.wait_for_peer(WAIT_S)
    sink.send(frame(2))
    found = [received(source) for _ in range(3)]
    assert found[0] in layers
    assert sorted(found, key=str) == sorted([*layers, frame(2)], key=str)


def test_who_joins_late_gets_all_layers_sent_so_far(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(open_link_sink(listening(endpoint, lossless=False)))
    layers = [serialise(LayerPacket(0, number, b"piece")) for number in range(6)]
    first = serialise(replace(MODEL, progressive=True))
    for packet in [first, *layers[:4], frame(0)]:
        sink.send(packet)
    source = stack.enter_context(open_link_source(connecting(endpoint, lossless=False)))
    sink.wait_for_peer(WAIT_S)
    for packet in [*layers[4:], frame(1)]:
        sink.send(packet)
    found = [received(source) for _ in range(8)]
    assert sorted(found, key=str) == sorted([first, *layers, frame(1)], key=str)


def test_who_joins_a_lossless_call_late_gets_all_of_it(stack: ExitStack, endpoint: str) -> None:
    sent = [MODEL_BYTES, *map(frame, range(100)), END]
    sink = stack.enter_context(open_link_sink(listening(endpoint)))
    for packet in sent:
        sink.send(packet)
    assert list(stack.enter_context(open_link_source(connecting(endpoint)))) == sent


def test_receiving_times_out_and_carries_on(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(open_link_source(listening(endpoint)))
    assert source.receive(timeout_s=0.001) is None
    assert not source.ended
    sink = stack.enter_context(open_link_sink(connecting(endpoint)))
    sink.wait_for_peer(WAIT_S)
    sink.send(MODEL_BYTES)
    assert received(source) == MODEL_BYTES
    assert source.receive(timeout_s=0) is None


def test_an_encoder_that_goes_without_a_word_ends_the_call(stack: ExitStack, endpoint: str) -> None:
    source = stack.enter_context(open_link_source(listening(endpoint)))
    with open_link_sink(connecting(endpoint)) as sink:
        sink.wait_for_peer(WAIT_S)
        sink.send(MODEL_BYTES)
    assert list(source) == [MODEL_BYTES]
    assert source.ended and not source.complete


@pytest.mark.parametrize("waiting", ["connecting", "receiving"])
def test_ctrl_c_ends_the_wait_at_once(waiting: str, endpoint: str) -> None:
    program = (
        "import sys; from protocol.link.interface import LinkOptions\n"
        "from protocol.link.carriers import open_link_source\n"
        "try:\n"
        "    print('ready', flush=True)\n"
        "    where = {sys.argv[1]: (sys.argv[2],)}\n"
        "    options = LinkOptions('test', **where, connect_timeout_s=600)\n"
        "    with open_link_source(options) as source:\n"
        "        print('open', flush=True); source.receive()\n"
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
        "open_link_source(LinkOptions('test', connect=(endpoint,), connect_timeout_s=600), say)",
        "open_link_source(LinkOptions('test', listen=(endpoint,)), say).receive()",
        "open_link_sink(LinkOptions('test', listen=(endpoint,)), say).wait_for_peer(600)",
    ],
    ids=["connecting", "receiving", "waiting"],
)
def test_ctrl_c_ends_the_wait_whichever_thread_takes_it(wait: str, endpoint: str) -> None:
    program = (
        "import os, signal, sys, threading\n"
        "from protocol.link.interface import LinkOptions\n"
        "from protocol.link.carriers import open_link_sink, open_link_source\n"
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


@pytest.mark.parametrize("end", ["open_link_source", "open_link_sink"])
def test_a_program_ends_whenever_its_link_is_interrupted_while_it_opens(end: str) -> None:
    program = (
        "import sys; from itertools import count; from time import monotonic\n"
        "from signal import ITIMER_REAL, SIGALRM, setitimer, signal\n"
        "import protocol.link.carriers as link\n"
        "from protocol.link.interface import LinkOptions\n"
        "def interrupt(*_): raise KeyboardInterrupt\n"
        "options, opened = LinkOptions('test', listen=('tcp/127.0.0.1:0',)), 0\n"
        "for _ in range(2):\n"
        "    begun_s = monotonic()\n"
        "    with getattr(link, sys.argv[1])(options): took_s = monotonic() - begun_s\n"
        "signal(SIGALRM, interrupt)\n"
        # On a busy machine opening takes longer.
        "step_s = max(1e-5, took_s / 400)\n"
        "for number in count(1):\n"
        "    try:\n"
        "        setitimer(ITIMER_REAL, number * step_s)\n"
        "        with getattr(link, sys.argv[1])(options): setitimer(ITIMER_REAL, 0)\n"
        "        opened += 1\n"
        "    except KeyboardInterrupt: pass\n"
        "    if opened == 100: sys.exit(7)\n"
    )
    child = subprocess.run([sys.executable, "-c", program, end], check=False, timeout=WAIT_S)
    assert child.returncode == 7


@pytest.mark.parametrize("end", ["open_link_source", "open_link_sink"])
def test_a_program_may_end_with_a_link_that_is_open(end: str) -> None:
    # With these times the thread of the link is nearly always in a function of Zenoh.
    program = (
        "import sys; import protocol.link.link_service as service\n"
        "import protocol.link.carriers as link\n"
        "from protocol.link.interface import LinkOptions\n"
        "service.TICK_S = service.CHECK_S = 0\n"
        "steps, step = [], service.LinkService.step\n"
        "service.LinkService.step = lambda self: (steps.append(0), step(self))\n"
        "options = LinkOptions('test', listen=('tcp/127.0.0.1:0',))\n"
        "end = getattr(link, sys.argv[1])(options)\n"
        "while len(steps) < 100: pass\n"
        "sys.exit(7)\n"
    )
    child = subprocess.run([sys.executable, "-c", program, end], check=False, timeout=WAIT_S)
    assert child.returncode == 7
