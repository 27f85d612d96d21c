"""Chooses what carries a call: Zenoh, or a device of a scheme of its own."""

from collections.abc import Callable, Mapping
from functools import partial

from protocol.endpoint import Endpoint, parse_endpoint
from protocol.link.interface import LinkOptions, MessageCallback, ignore_message
from protocol.link.link_end import CarrierFactory
from protocol.link.link_protection import link_protection
from protocol.link.link_sink import LinkSink
from protocol.link.link_source import LinkSource
from protocol.link.messages import Role
from shared_model.errors import UserError


def _serial_line(device: Endpoint, is_listening: bool) -> CarrierFactory:
    from protocol.link.serial_carrier import SerialCarrier

    return partial(SerialCarrier, device, is_listening)


# What makes the connections of a device, by its scheme, one of `DEVICE_SCHEMES`; given the device
# and whether the end listens there.  Each is loaded where used: the others need no such library.
DEVICE_CARRIERS: Mapping[str | None, Callable[[Endpoint, bool], CarrierFactory]] = {
    "serial": _serial_line,
}


def carrier_factory(options: LinkOptions, role: Role, say: MessageCallback) -> CarrierFactory:
    """What makes the connections of an end.

    Raises `UserError` if it would have to be two things at once.
    """
    places = [parse_endpoint(text) for text in (*options.listen, *options.connect)]
    device = next((place for place in places if place.is_device), None)
    if device is None:
        from protocol.link.zenoh_link import ZenohCarrier

        return partial(ZenohCarrier, options, role, say)
    if len(places) > 1:
        raise UserError(f"a {device.scheme} line goes alone: name no other endpoint")
    return DEVICE_CARRIERS[device.scheme](device, bool(options.listen))


def open_link_sink(options: LinkOptions, say: MessageCallback = ignore_message) -> LinkSink:
    """The encoder's end of a call.  Raises `UserError`, see `LinkSink`."""
    make = carrier_factory(options, Role.ENCODER, say)
    return LinkSink(options, link_protection(options, True, say), make, say)


def open_link_source(options: LinkOptions, say: MessageCallback = ignore_message) -> LinkSource:
    """A decoder's end of a call.  Raises `UserError`, see `LinkSource`."""
    make = carrier_factory(options, Role.DECODER, say)
    return LinkSource(options, link_protection(options, False, say), make, say)
