"""The ends of the calls of a measurement: all callers in one process, all subscribers in another.

A packet is the time at which it was sent, 0 before the measurement has begun, and a frame packet.
"""

import json
import os
import random
import sys
import time
from collections.abc import Sequence
from functools import partial
from select import select
from struct import Struct

import zenoh

from protocol.packets import FramePacket, parse_packet, serialise

# As long as a frame packet of 800 bit/s with SFrame, and as often.
PACKET_BYTES, PACKETS_PER_S = 32, 3.125
WARM_UP_S = 0.1
NAP_S = 0.01
_TIME = Struct(">d")


def main(arguments: Sequence[str]) -> None:
    """callers ENDPOINT CALLS SECONDS, or subscribers ENDPOINT CALLS SUBSCRIBERS_OF_EACH."""
    end, endpoint, calls, number = arguments
    if end == "callers":
        send(endpoint, int(calls), float(number))
    else:
        subscribe(endpoint, int(calls), int(number))
    # Hundreds of sessions take long to close.
    os._exit(0)


def send(endpoint: str, calls: int, seconds: float) -> None:
    """Send packets that do not count until standard input has a line, then, for `seconds`, those
    that do, those of each call at times of their own; print their number and the CPU time."""
    sessions = [_session(endpoint) for _ in range(calls)]
    order = random.Random(1).sample(range(calls), calls)
    print("ready", flush=True)
    while not select([sys.stdin], [], [], WARM_UP_S)[0]:
        for call, session in enumerate(sessions):
            session.put(f"d/{call}", _packet(0.0))
    begun_s, busy_s = time.monotonic(), time.process_time()
    count = int(seconds * calls * PACKETS_PER_S)
    for number in range(count):
        due_s = begun_s + (number + 1) / (calls * PACKETS_PER_S)
        time.sleep(max(0.0, due_s - time.monotonic()))
        call = order[number % calls]
        sessions[call].put(f"d/{call}", _packet(time.monotonic()))
    print(json.dumps([count, time.process_time() - busy_s]), flush=True)
    sys.stdin.read()


def subscribe(endpoint: str, calls: int, subscribers: int) -> None:
    """Parse all packets; print a line once each subscriber has one.

    Standard input ends with how many shall come, and for how long nothing may come until the others
    are given up, seconds.  Then the delay of each packet is printed, seconds.
    """
    delays: list[float] = []
    silent = set(range(calls * subscribers))

    def receive(subscriber: int, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes()
        assert isinstance(parse_packet(data[_TIME.size :]), FramePacket)
        (sent_s,) = _TIME.unpack_from(data)
        if sent_s:
            delays.append(time.monotonic() - sent_s)
        elif subscriber in silent:
            silent.discard(subscriber)
            if not silent:
                print("all have received", flush=True)

    for number in range(calls * subscribers):
        handler = zenoh.handlers.Callback(partial(receive, number), indirect=False)
        session = _session(endpoint)
        session.declare_subscriber(f"d/{number % calls}", handler)
        _SESSIONS.append(session)
    print("ready", flush=True)
    expected, patience_s = sys.stdin.read().split()
    waited_s, came = 0.0, len(delays)
    while len(delays) < int(expected) and waited_s < float(patience_s):
        time.sleep(NAP_S)
        waited_s = 0.0 if len(delays) > came else waited_s + NAP_S
        came = len(delays)
    print(json.dumps(delays), flush=True)


# Subscriptions end with their session.
_SESSIONS: list[zenoh.Session] = []


def _packet(sent_s: float) -> bytes:
    head = _TIME.pack(sent_s)
    payload = bytes(PACKET_BYTES - len(head) - 1)
    return head + serialise(FramePacket(0, payload))


def _session(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    for name, value in (
        ("mode", "client"),
        ("scouting/multicast/enabled", False),
        ("connect/endpoints", [endpoint]),
        ("connect/timeout_ms", 60_000),
        ("transport/link/tx/sequence_number_resolution", "8bit"),
    ):
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


if __name__ == "__main__":
    main(sys.argv[1:])
