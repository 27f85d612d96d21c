"""Calls on the local network: finding the other end by the call's name, and being found."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ipaddress import IPv4Address, ip_address
from typing import TYPE_CHECKING

from protocol.endpoint import DEFAULT_SCHEMES, Endpoint, OwnAddress, parse_endpoint
from shared_model.errors import LINK_FAILED, UserError

if TYPE_CHECKING:
    from protocol.discovery import FoundCall

# How long a call is looked for if nothing else is said.
SEARCH_S = 10.0


def find_call(call: str, is_encoder: bool, wait_s: float) -> "FoundCall":
    """The end that listens on the local network for this end of a call.

    wait_s: 0: `SEARCH_S`.  Raises `UserError` with exit code 4 if there is none by then.
    """
    from protocol.discovery import find_calls

    others = set[str]()
    for found in find_calls(wait_s or SEARCH_S):
        if found.call == call and found.is_encoder != is_encoder:
            return found
        others.add(f"{'an encoder' if found.is_encoder else 'a decoder'} of call {found.call!r}")
    who = f"; there is {', '.join(sorted(others))}" if others else ""
    end = "a decoder" if is_encoder else "an encoder"
    raise UserError(
        f"{end} of call {call!r} does not listen on the local network{who}", LINK_FAILED
    )


@contextmanager
def announced(
    call: str, listen: Sequence[str], is_encoder: bool, needs_invitation: bool
) -> Iterator[None]:
    """Answer within the `with` block who looks for calls on the local network.

    An end that does not listen beyond this host, or not over UDP or TCP, does not answer.
    """
    place = next(filter(_is_open, map(parse_endpoint, listen)), None)
    if place is None:
        yield
        return
    from protocol.discovery import CallAnnouncer, FoundCall

    found = FoundCall(call, "", place.port, is_encoder, needs_invitation)
    with CallAnnouncer(found, _interface(place), OwnAddress(place.host)):
        yield


def _is_open(place: Endpoint) -> bool:
    """Whether who is on the local network can connect to it by its address alone."""
    is_default = place.scheme is None or place.scheme in DEFAULT_SCHEMES
    return is_default and not place.is_loopback and bool(place.port)


def _interface(place: Endpoint) -> str | None:
    """The address of the one network interface that is listened on; None: all, or not known."""
    try:
        is_one = isinstance(ip_address(place.host), IPv4Address) and not place.is_any
    except ValueError:
        return None
    return place.host if is_one else None
