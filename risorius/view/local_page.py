"""A page for programs of this host that know its address, served by threads."""

import sys
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, cast
from urllib.parse import SplitResult, urlsplit

from protocol.link.endpoints import bind_reason
from risorius.call_page.access import HEADERS, HOST, Access, not_served, random_token

TEXT, JSON, HTML, JPEG = "text/plain", "application/json", "text/html; charset=utf-8", "image/jpeg"


class PageServer(ThreadingHTTPServer):
    """Serves a page on a TCP port of this host; 0: any free one.

    Raises `UserError` if the port cannot be had.
    """

    # A request that waits for its picture does not delay the end.
    daemon_threads, block_on_close = True, False

    def __init__(self, port: int, handler: "type[PageHandler]") -> None:
        try:
            super().__init__((HOST, port), handler)
        except OSError as error:
            raise not_served(port, bind_reason(error)) from error
        self.access = Access(self.server_port, random_token())

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that is closed while its picture is drawn is no error."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class PageHandler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    protocol_version = "HTTP/1.1"
    # A picture is sent in two writes, and the second must not wait for the first's receipt.
    disable_nagle_algorithm = True
    server: PageServer

    def admitted(self) -> SplitResult | None:
        """Where a request goes, below the secret part of the address; None: it was refused."""
        where = urlsplit(self.path)
        token, _, name = where.path.removeprefix("/").partition("/")
        headers = cast(Mapping[str, str], self.headers)
        reason = self.server.access.refusal(headers, token, is_websocket=False)
        if reason is None:
            return where._replace(path=name)
        # What the request holds beside is not read: the connection cannot be used again.
        self.close_connection = True
        self.reply(HTTPStatus.FORBIDDEN, TEXT, f"{reason}\n".encode())
        return None

    def reply(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        """Answer with a body of this media type."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def no_such_page(self) -> None:
        """Answer a request for what is not there."""
        self.reply(HTTPStatus.NOT_FOUND, TEXT, b"no such page\n")

    def log_message(self, format: str, *arguments: Any) -> None:
        """Nothing: a line for each picture would bury the page's address."""
