"""A call over a serial line: the second carrier."""

import os
from functools import partial
from typing import cast

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from processes import until
from serial_lines import serial_line

from protocol.endpoint import DEVICE_SCHEMES, parse_endpoint, parse_remote_endpoint
from protocol.link.carriers import (
    DEVICE_CARRIERS,
    carrier_factory,
    open_link_sink,
    open_link_source,
)
from protocol.link.connection import LISTENING, Carrier, Event, Failed, Opened
from protocol.link.endpoints import Failure, check_listening
from protocol.link.interface import LinkOptions
from protocol.link.link_service import LinkService
from protocol.link.messages import Role
from protocol.link.serial_carrier import DEFAULT_BAUD, SerialCarrier, baud_of, stuffed, unstuffed
from protocol.link.zenoh_link import ZenohCarrier
from protocol.packets import ControlKind, ControlPacket, serialise
from shared_model.errors import UserError

END = serialise(ControlPacket(0, ControlKind.END, 1))
LIMIT_S = 20.0


@example(bytes([1]) * 254)
@example(bytes([1]) * 700 + b"\0")
@given(st.binary(max_size=600) | st.lists(st.sampled_from([0, 1, 255]), max_size=600).map(bytes))
def test_what_is_stuffed_has_no_zero_and_comes_back(payload: bytes) -> None:
    sent = stuffed(payload)
    assert sent[:1] == sent[-1:] == b"\0" and b"\0" not in sent[1:-1]
    assert unstuffed(sent[1:-1]) == payload


@given(st.binary(max_size=300))
def test_damaged_bytes_are_a_payload_or_nothing(data: bytes) -> None:
    found = unstuffed(data.replace(b"\0", b"\1"))
    assert found is None or len(found) <= len(data)


def test_an_endpoint_may_be_a_serial_line() -> None:
    plain, slow = parse_endpoint("serial//dev/ttyUSB0"), parse_endpoint("serial/COM3?baud=9600")
    assert (plain.host, baud_of(plain), plain.address) == ("/dev/ttyUSB0", DEFAULT_BAUD, plain.host)
    assert (slow.host, baud_of(slow)) == ("COM3", 9600)
    assert plain.is_device and plain.is_loopback and not plain.is_reliable
    assert parse_remote_endpoint("serial/COM3") == parse_endpoint("serial/COM3")
    check_listening(["serial/COM3"])
    for wrong in ("serial/", "serial/COM3?baud=fast", "serial/a b"):
        with pytest.raises(UserError, match="serial/DEVICE"):
            parse_endpoint(wrong)
    with pytest.raises(UserError, match=r"expected \?baud=RATE"):
        baud_of(parse_endpoint("serial/COM3?speed=9"))


def test_packets_go_over_the_line_though_noise_comes_first() -> None:
    with serial_line(b"\x05noise\xff") as (here, there):
        receiving = LinkOptions("call", connect=(f"serial/{there}",))
        with (
            open_link_sink(LinkOptions("call", listen=(f"serial/{here}",)), print) as sink,
            open_link_source(receiving, print) as source,
        ):
            sink.send(END)
            arrival = source.receive(LIMIT_S)
            assert arrival is not None and arrival.data == END
            assert source.receive(LIMIT_S) is None and source.ended


def test_a_line_that_is_not_there_is_one_line_of_text() -> None:
    with pytest.raises(UserError, match=r"cannot listen on /dev/none: .*No such file"):
        open_link_sink(LinkOptions("call", listen=("serial//dev/none",)), print)
    nowhere = LinkOptions("call", connect=("serial//dev/none",), connect_timeout_s=0.1)
    with pytest.raises(UserError, match=r"cannot reach serial//dev/none within .*no way leads"):
        open_link_source(nowhere, print)
    with pytest.raises(UserError, match="a serial line goes alone"):
        open_link_sink(LinkOptions("call", connect=("serial/COM3", "127.0.0.1")), print)


class Events:
    """What a carrier tells the service of its end."""

    def __init__(self) -> None:
        self.told = list[Event]()

    def post(self, event: Event) -> None:
        self.told.append(event)


def test_a_line_stays_open_from_one_connection_to_the_next_until_the_end() -> None:
    with serial_line() as (here, _):
        events = Events()
        carrier = SerialCarrier(parse_endpoint(f"serial/{here}"), False, cast(LinkService, events))
        assert not carrier.is_linked(0)
        for connection in range(2):
            carrier.open(connection, parse_endpoint(f"serial/{here}"))
            carrier.close(connection)
        assert events.told == [Opened(0), Opened(1)] and carrier.is_linked(1)
        carrier.close_all()
        carrier.put(1, b"too late", is_frame=False, is_hello=False)
        assert not carrier.is_linked(1)
        carrier.close_all()
    gone = SerialCarrier(parse_endpoint("serial//dev/none"), False, cast(LinkService, events))
    gone.open(2, parse_endpoint("serial//dev/none"))
    assert events.told[-1] == Failed(2, Failure.UNREACHABLE)


def test_everything_else_goes_over_zenoh() -> None:
    options = LinkOptions("call", connect=("127.0.0.1:7447",))
    make = cast("partial[Carrier]", carrier_factory(options, Role.ENCODER, print))
    assert make.func is ZenohCarrier


def test_every_device_has_a_carrier() -> None:
    assert DEVICE_CARRIERS.keys() == set(DEVICE_SCHEMES)


def test_a_line_that_is_pulled_out_is_noticed() -> None:
    ours, theirs = os.openpty()
    place = parse_endpoint(f"serial/{os.ttyname(theirs)}")
    carrier = SerialCarrier(place, True, cast(LinkService, Events()))
    assert carrier.is_linked(LISTENING)
    os.close(theirs)
    os.close(ours)
    until(lambda: not carrier.is_linked(LISTENING))
    carrier.put(LISTENING, b"too late", is_frame=False, is_hello=False)
    carrier.close_all()
