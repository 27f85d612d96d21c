"""Where an end listens or connects to, as a user names it: [SCHEME/][HOST][:PORT], or
serial/DEVICE[?baud=RATE] for a serial line.

Without a scheme an end listens for, or tries, all of `DEFAULT_SCHEMES` on one port number.
"""

import re
import socket
import struct
import sys
from dataclasses import dataclass, replace
from ipaddress import ip_address

from protocol.limits import DEFAULT_PORT, MAX_MESSAGE_LENGTH, MAX_PORT
from shared_model.errors import UserError

SCHEMES = ("tcp", "udp", "tls", "quic", "ws")
# Both ends show a certificate.
CERTIFIED_SCHEMES = ("tls", "quic")
# Of what connects two devices without a network, each with a carrier of its own, see
# `link.carriers`.
DEVICE_SCHEMES = ("serial",)
# How a user names one.
DEVICE_FORMS = " or ".join(f"{scheme}/DEVICE" for scheme in DEVICE_SCHEMES)
# Tried in this order.
DEFAULT_SCHEMES = ("udp", "tcp")
ANY_HOST = "0.0.0.0"
# A host that no packet is sent to: its route tells the address that others see.
_FAR_HOST = ("192.0.2.1", 9)
# From linux/sockios.h.
_SIOCGIFADDR = 0x8915

_ENDPOINT = re.compile(
    rf"((?P<scheme>{'|'.join(SCHEMES)})/)?(?P<host>\[[0-9A-Fa-f:.]+\]|[^\s:/?#@\[\]]*)"
    r"(:(?P<port>\d{1,5}))?(?P<options>(\?[^\s#]*)?(#\S*)?)"
)
_DEVICE = re.compile(
    rf"(?P<scheme>{'|'.join(DEVICE_SCHEMES)})/(?P<device>[^\s?]+)"
    r"(?P<options>\?[a-z]+=[1-9]\d{0,7})?"
)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One endpoint.

    scheme: None: any of `DEFAULT_SCHEMES`.  host: an IPv6 address without brackets; of a
        `DEVICE_SCHEMES` the device.
    options: as Zenoh has them, with ? or # in front; empty: none.
    """

    scheme: str | None
    host: str
    port: int
    options: str = ""

    @property
    def address(self) -> str:
        """HOST:PORT, or a device."""
        if self.is_device:
            return self.host
        return f"{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    @property
    def choices(self) -> tuple["Endpoint", ...]:
        """The endpoints that it stands for, each with a scheme, the best first."""
        schemes = DEFAULT_SCHEMES if self.scheme is None else (self.scheme,)
        return tuple(replace(self, scheme=scheme) for scheme in schemes)

    @property
    def locators(self) -> tuple[str, ...]:
        """What Zenoh is given for them."""
        return tuple(f"{each.scheme}/{each.address}{each.options}" for each in self.choices)

    @property
    def is_reliable(self) -> bool:
        """Whether nothing is lost on the way and the set-up repeats itself."""
        return self.scheme not in ("udp", *DEVICE_SCHEMES) or "rel=1" in self.options

    @property
    def is_device(self) -> bool:
        """Whether the endpoint is a device of this host, not a place in a network."""
        return self.scheme in DEVICE_SCHEMES

    @property
    def is_quic(self) -> bool:
        """Whether the endpoint is QUIC's, which does not tell at once that an end has gone."""
        return self.scheme == "quic" or (self.scheme == "udp" and self.is_reliable)

    @property
    def is_loopback(self) -> bool:
        """Whether only this host can reach the endpoint, or who is at the other end of a line."""
        if self.is_device or self.host == "localhost":
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def is_any(self) -> bool:
        """Whether the endpoint stands for all addresses of this host."""
        try:
            return ip_address(self.host).is_unspecified
        except ValueError:
            return False


def parse_endpoint(text: str) -> Endpoint:
    """The endpoint that a user named.

    Without a host: all addresses of this host.  Without a port: `DEFAULT_PORT`.
    Raises `UserError` if the text is no endpoint.
    """
    if device := _DEVICE.fullmatch(text):
        return Endpoint(device["scheme"], device["device"], 0, device["options"] or "")
    parts = _ENDPOINT.fullmatch(text)
    if parts is None or not text:
        raise UserError(
            f"endpoint {text[:MAX_MESSAGE_LENGTH]!r}: expected HOST:{DEFAULT_PORT},"
            f" with a scheme as in tcp/HOST:{DEFAULT_PORT}, or {DEVICE_FORMS}"
        )
    port = int(parts["port"] or DEFAULT_PORT)
    if port > MAX_PORT:
        raise UserError(f"endpoint {text!r}: ports go up to {MAX_PORT}")
    return Endpoint(parts["scheme"], parts["host"].strip("[]") or ANY_HOST, port, parts["options"])


def parse_remote_endpoint(text: str) -> Endpoint:
    """The endpoint to connect to.  Raises `UserError` if nobody can be there."""
    endpoint = parse_endpoint(text)
    if endpoint.is_device:
        return endpoint
    if not endpoint.port:
        raise UserError(f"endpoint {text!r}: nobody listens on port 0")
    if endpoint.is_any:
        raise UserError(f"endpoint {text!r}: name the host to connect to")
    return endpoint


def address_for_others() -> str | None:
    """The address of this host on its default route, else of any network interface but loopback.

    None: this host has no network.  Sends nothing.
    """
    for family, host in ((socket.AF_INET, _FAR_HOST), (socket.AF_INET6, ("2001:db8::1", 9))):
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect(host)
            except OSError:
                continue
            return str(probe.getsockname()[0])
    return next(filter(None, map(_interface_address, _interfaces())), None)


class OwnAddress:
    """The address of this host where an end listens, as it changes.

    host: as it was named: all addresses, one, or a name.  Sends nothing but to a name server.
    """

    def __init__(self, host: str) -> None:
        self._is_any = Endpoint(None, host, 0).is_any
        self._interface = None if self._is_any else _interface_with(host)

    @property
    def now(self) -> str | None:
        """The address now; None: there is none, or another interface than loopback never had it."""
        if self._is_any:
            return address_for_others()
        return None if self._interface is None else _interface_address(self._interface)


def _interface_with(host: str) -> str | None:
    """Name of the interface with an address of `host`; None: there is none."""
    try:
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        return None
    addresses = {str(address[0]) for *_, address in found}
    return next((name for name in _interfaces() if _interface_address(name) in addresses), None)


def _interfaces() -> list[str]:
    """Names of this host's network interfaces, on Linux."""
    return [name for _, name in socket.if_nameindex()] if sys.platform == "linux" else []


def _interface_address(name: str) -> str | None:
    """The IPv4 address of a network interface; None: it has none, or is loopback."""
    import fcntl

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        request = struct.pack("256s", name.encode()[:15])
        try:
            reply = fcntl.ioctl(probe, _SIOCGIFADDR, request)
        except OSError:
            return None
    address = ip_address(reply[20:24])
    return None if address.is_loopback else str(address)
