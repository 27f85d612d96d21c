"""Packets of a pipe keep the time at which they came."""

import os
import time

from layer_streams import BASE, frames

from protocol.call_file import CallReader, CallStreamWriter
from protocol.packets import ControlKind, ControlPacket, serialise
from risorius.live_call.packets.traffic_meter import StampedSource

PACKETS = [serialise(BASE), *frames(3), serialise(ControlPacket(0, ControlKind.END, 3))]


def test_packets_come_with_the_time_of_their_arrival_until_the_end() -> None:
    reading, writing = os.pipe()
    with (
        os.fdopen(writing, "wb", buffering=0) as pipe,
        CallStreamWriter(pipe) as sink,
        StampedSource(CallReader(os.fdopen(reading, "rb"))) as source,
    ):
        assert source.receive(0.0) is None and not source.ended
        begun_s = time.monotonic()
        for packet in PACKETS:
            sink.send(packet)
        arrivals = [source.receive() for _ in PACKETS]
        assert [each.data for each in arrivals if each is not None] == PACKETS
        times_s = [each.time_s for each in arrivals if each is not None]
        assert begun_s <= times_s[0] and times_s == sorted(times_s)
        assert source.receive() is None and source.ended and source.complete


def test_a_pipe_whose_writer_is_gone_has_ended() -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "wb", buffering=0) as pipe, CallStreamWriter(pipe) as sink:
        sink.send(PACKETS[0])
    with StampedSource(CallReader(os.fdopen(reading, "rb"))) as source:
        assert list(source) == PACKETS[:1]
        assert source.ended and not source.complete
