"""Calls with SFrame over real Zenoh sessions: nobody else is heard, nobody else can read."""

import json
import random
import socket
from collections.abc import Callable
from contextlib import ExitStack

import pytest
import zenoh
from links import WAIT_S
from packets import MODEL
from processes import until

from loopback.process_pair import free_port
from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.interface import LinkOptions
from protocol.link.link_protection import STRANGERS
from protocol.link.link_sink import LinkSink
from protocol.link.link_source import LinkSource
from protocol.link.presence import call_keys
from protocol.packets import ControlKind, ControlPacket, FramePacket, serialise
from protocol.relay.zenoh_relay import Relay, RelayOptions
from protocol.security.link_security import LinkSecurity
from shared_model.errors import UserError

KEY, OTHER_KEY = bytes(range(16)), bytes(16)
CALL = "test"
MODEL_BYTES = serialise(MODEL)
FLOOD = 10_000


def options(
    key: bytes | None, listen: tuple[str, ...] = (), connect: tuple[str, ...] = ()
) -> LinkOptions:
    return LinkOptions(
        CALL,
        listen,
        connect,
        connect_timeout_s=WAIT_S,
        lossless=True,
        security=LinkSecurity(key),
    )


def packets_of(word: str, count: int = 20) -> list[bytes]:
    """A whole call whose frame packets have a word in them."""
    payloads = [f"{word} {number:05}".encode() for number in range(count)]
    frames = [serialise(FramePacket(i % 64, payload)) for i, payload in enumerate(payloads)]
    return [MODEL_BYTES, *frames, serialise(ControlPacket(count % 64, ControlKind.END, count))]


def pass_on(
    source: LinkSource, sink: LinkSink, packets: list[bytes], each: Callable[[], None]
) -> list[bytes]:
    """What comes of packets that are sent; `each` is called after each one."""
    sink.wait_for_peer(WAIT_S)
    for packet in packets:
        sink.send(packet)
        each()
    received = list[bytes]()
    while (arrival := source.receive(WAIT_S)) is not None:
        received.append(arrival.data)
    return received


def client(stack: ExitStack, endpoint: str) -> zenoh.Session:
    """Somebody who can reach the call but has no key."""
    config = zenoh.Config()
    for name, value in (
        ("mode", "client"),
        ("scouting/multicast/enabled", False),
        ("connect/endpoints", [endpoint]),
        ("connect/timeout_ms", round(1000 * WAIT_S)),
    ):
        config.insert_json5(name, json.dumps(value))
    return stack.enter_context(zenoh.open(config))


@pytest.mark.parametrize("key", [None, OTHER_KEY], ids=["no invitation", "another's"])
def test_who_lacks_the_key_is_not_heard_and_that_is_said_once(
    key: bytes | None, stack: ExitStack, endpoint: str
) -> None:
    said = list[str]()
    source = stack.enter_context(open_link_source(options(KEY, listen=(endpoint,)), said.append))
    with open_link_sink(options(key, connect=(endpoint,))) as intruder:
        for packet in packets_of("forged"):
            intruder.send(packet)
        until(lambda: STRANGERS in said)
        with pytest.raises(UserError, match="no decoder came"):
            intruder.wait_for_peer(1.5)
    packets = packets_of("true")
    with open_link_sink(options(KEY, connect=(endpoint,))) as sink:
        assert pass_on(source, sink, packets, lambda: None) == packets
    assert said.count(STRANGERS) == 1


def test_who_has_the_wrong_invitation_is_told(
    stack: ExitStack, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("protocol.link.link_end.UNREAD_S", 0)
    said = list[str]()
    stack.enter_context(open_link_source(options(KEY, listen=(endpoint,))))
    sink = stack.enter_context(open_link_sink(options(OTHER_KEY, connect=(endpoint,)), said.append))

    def give_up() -> UserError:
        with pytest.raises(UserError, match="no decoder came") as caught:
            sink.wait_for_peer(0)
        return caught.value

    until(lambda: "has another invitation" in said[-1], give_up)
    assert said[-1] in str(give_up())


def test_a_decoder_without_the_key_gets_nothing(stack: ExitStack, endpoint: str) -> None:
    sink = stack.enter_context(open_link_sink(options(KEY, listen=(endpoint,))))
    thief = stack.enter_context(open_link_source(options(OTHER_KEY, connect=(endpoint,))))
    with open_link_source(options(KEY, connect=(endpoint,))) as source:
        packets = packets_of("secret")
        assert pass_on(source, sink, packets, lambda: None) == packets
    assert thief.receive(0.3) is None


def test_who_looks_into_a_relay_sees_no_packet_and_repeats_or_changes_them_in_vain(
    stack: ExitStack, endpoint: str
) -> None:
    stack.enter_context(Relay(RelayOptions((endpoint,))))
    seen = list[tuple[str, bytes]]()

    def look(sample: zenoh.Sample) -> None:
        seen.append((str(sample.key_expr), sample.payload.to_bytes()))

    spy = client(stack, endpoint)
    for key in call_keys(CALL, is_encoder=True):
        spy.declare_subscriber(key, look)
    chance = random.Random(1)

    def meddle() -> None:
        """Repeat something of what has been seen, and change something."""
        for key, payload in chance.choices(list(seen), k=40):
            changed = bytearray(payload)
            changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
            spy.put(key, payload)
            spy.put(key, bytes(changed))

    for word in ("first", "again"):
        packets = packets_of(word)
        with (
            open_link_source(options(KEY, connect=(endpoint,))) as source,
            open_link_sink(options(KEY, connect=(endpoint,))) as sink,
        ):
            meddling = meddle if word == "again" else lambda: None
            assert pass_on(source, sink, packets, meddling) == packets
        payloads = [payload for _, payload in seen]
        assert len(payloads) > len(packets)
        assert not any(word.encode() in payload for payload in payloads)
        assert not any(MODEL_BYTES[10:40] in payload for payload in payloads)


def test_a_flood_of_garbage_harms_no_call(stack: ExitStack, endpoint: str) -> None:
    said = list[str]()
    source = stack.enter_context(open_link_source(options(KEY, listen=(endpoint,)), said.append))
    sink = stack.enter_context(open_link_sink(options(KEY, connect=(endpoint,))))
    intruder = client(stack, endpoint)
    down, _ = call_keys(CALL, is_encoder=True)
    chance = random.Random(1)
    packets = packets_of("true")

    def flood() -> None:
        for _ in range(FLOOD // len(packets)):
            garbage = chance.randbytes(chance.randrange(60))
            intruder.put(down, garbage, congestion_control=zenoh.CongestionControl.BLOCK)

    assert pass_on(source, sink, packets, flood) == packets
    assert said.count(STRANGERS) == 1


def test_a_flood_of_datagrams_at_its_port_harms_no_call(stack: ExitStack) -> None:
    port = free_port()
    place = f"udp/127.0.0.1:{port}"
    source = stack.enter_context(open_link_source(options(KEY, listen=(place,))))
    sink = stack.enter_context(open_link_sink(options(KEY, connect=(place,))))
    intruder = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    chance = random.Random(1)
    packets = packets_of("true")

    def flood() -> None:
        for _ in range(FLOOD // len(packets)):
            intruder.sendto(chance.randbytes(chance.randrange(1, 60)), ("127.0.0.1", port))

    assert pass_on(source, sink, packets, flood) == packets
