"""Who may see and steer a call: programs of this host that know the page's address.

The address has a secret part.  Other pages in the same browser can send requests to this host, too,
and a name that its owner lets point to this host makes a foreign page's requests look like its own;
so the names in `Host` and `Origin` are checked as well.
"""

import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from hmac import compare_digest

from protocol.link.endpoints import why_not_bound
from shared_model.errors import LINK_FAILED, UserError

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
TOKEN_BYTES = 16
# What a browser says of a request that another page has made.
FOREIGN_SITES = ("cross-site", "same-site")

# The page takes nothing from elsewhere and may not be shown within another one.
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval';"
        " style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; media-src blob:;"
        " worker-src 'self'; connect-src 'self';"
        " frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


@dataclass(frozen=True, slots=True)
class Access:
    """What a request must know.  token: the secret part of the address."""

    port: int
    token: str = field(repr=False)

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    def refusal(self, headers: Mapping[str, str], token: str, is_websocket: bool) -> str | None:
        """Why a request is refused; None: it is not.

        headers: of the request; names in any case.  token: the secret part that it named.
        """
        hosts = [f"{name}:{self.port}" for name in NAMES]
        origin = headers.get("Origin")
        if headers.get("Host") not in hosts:
            return "this page is for its own host"
        if origin not in [None, *(f"http://{host}" for host in hosts)]:
            return "this page is not for other pages"
        if is_websocket and origin is None:
            return "a WebSocket names the page that opens it"
        if headers.get("Sec-Fetch-Site") in FOREIGN_SITES:
            return "this page is not for other pages"
        # Of bytes: strings may have letters that cannot be compared in constant time.
        if not compare_digest(token.encode(), self.token.encode()):
            return "no such page"
        return None


def random_token() -> str:
    """A secret part of an address that nobody guesses."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def check_port(port: int) -> None:
    """Raise `UserError` with exit code 4 if no page can be served on this TCP port; 0: any."""
    reason = why_not_bound(HOST, port, socket.SOCK_STREAM)
    if reason is not None:
        raise not_served(port, reason)


def not_served(port: int, reason: str) -> UserError:
    """What to raise for a page that cannot be served on this TCP port."""
    where = f"cannot serve the page on {HOST}:{port}"
    return UserError(f"{where}: {reason}; try another --port", LINK_FAILED)
