"""What a packet costs on the wire."""

import select
import socket
import threading
from contextlib import ExitStack
from statistics import mode

import pytest
from links import (
    MODEL_BYTES,
    WAIT_S,
    connecting,
    frame,
    free_endpoint,
    listening,
    port_of,
    received,
)

from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.interface import ZENOH_OVERHEAD_BYTES
from protocol.link.link_protection import CHECKSUM_BYTES


@pytest.mark.parametrize("listens", [True, False], ids=["listening", "connecting"])
def test_what_a_live_frame_costs_over_udp(stack: ExitStack, listens: bool) -> None:
    inner, outer = free_endpoint("udp"), free_endpoint("udp")
    if listens:
        sink = stack.enter_context(open_link_sink(listening(inner, lossless=False)))
        relay = stack.enter_context(MeasuringRelay(port_of(outer), port_of(inner)))
        source = stack.enter_context(open_link_source(connecting(outer, lossless=False)))
        sizes, key = relay.sizes_out, 0
    else:
        source = stack.enter_context(open_link_source(listening(inner, lossless=False)))
        relay = stack.enter_context(MeasuringRelay(port_of(outer), port_of(inner)))
        sink = stack.enter_context(open_link_sink(connecting(outer, lossless=False)))
        sizes, key = relay.sizes_in, 1 + len("d")
    sink.wait_for_peer(WAIT_S)
    sink.send(MODEL_BYTES)
    assert received(source) == MODEL_BYTES
    # Fewer than are remembered: the first ones go twice, the second time a little later.
    for number in range(40):
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
