"""Zenoh's settings for both ends of a link, by their names in its configuration."""

from collections.abc import Sequence
from typing import Any

from protocol.endpoint import Endpoint
from protocol.link.interface import LinkOptions
from protocol.security.link_security import LinkSecurity, tls_settings

Settings = dict[str, Any]

# How long a connection may take to open, by whether it repeats lost messages.
OPEN_S, RELIABLE_OPEN_S = 4.0, 10.0
MAX_MESSAGE_BYTES = 64 * 1024
# Messages that wait to be sent: the most that Zenoh allows.
QUEUED_BATCHES = 16

_COMMON: Settings = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    # Sequence numbers of one byte instead of up to five.
    "transport/link/tx/sequence_number_resolution": "8bit",
    "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
    # Of the default two a burst of pieces loses some before they are sent.
    "transport/link/tx/queue/size/data": QUEUED_BATCHES,
    # Every five seconds where nothing else is sent: less often than reports.
    "transport/link/tx/keep_alive": 2,
}


def listener_settings(options: LinkOptions, locators: Sequence[str]) -> Settings:
    """Of an end that listens; locators: where."""
    return _COMMON | {
        "mode": "peer",
        "listen/endpoints": list(locators),
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "connect/endpoints": [each[0].locators[0] for each in options.connect_endpoints],
    }


def client_settings(endpoint: Endpoint) -> Settings:
    """Of an end that connects to an endpoint."""
    open_s = RELIABLE_OPEN_S if endpoint.is_reliable else OPEN_S
    return _COMMON | {
        "mode": "client",
        "connect/endpoints": endpoint.locators,
        # A second try of the same session might be refused for ever.
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": True,
        "transport/unicast/open_timeout": round(1000 * open_s),
    }


def security_settings(security: LinkSecurity) -> Settings:
    """What mutual TLS takes, where there are certificates."""
    if security.key_file is None:
        return {}
    return {"transport/link/tls": tls_settings(security.key_file)}
