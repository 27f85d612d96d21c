"""The server of a relay's watching pages.

/CALL         the page that watches a call; its key stands behind a #, which browsers do not send
/CALL/ws      payloads of the link, as a decoder gets and sends them: what they say the relay
              does not know

The page opens the payloads itself (`player/watch`).  A slow one loses the oldest that wait for it.
"""

import asyncio
import socket
from collections import deque
from contextlib import suppress
from importlib.resources import files
from typing import Self

from aiohttp import WSMsgType, web

from protocol.limits import CALL_NAME
from protocol.link.endpoints import bind_reason
from protocol.link.messages import MAX_MESSAGE_BYTES
from protocol.relay.zenoh_relay import Relay, WatchedCall
from risorius.page.loop_thread import LoopThread
from shared_model.errors import LINK_FAILED, UserError

# Payloads that may wait for a page; a model's pieces come many at a time.
MAX_WAITING = 512
# Pages at a time.
MAX_PAGES = 2000
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:;"
        " worker-src 'self'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class _Page:
    """What one page has not received yet."""

    def __init__(self) -> None:
        self._waiting: deque[bytes] = deque(maxlen=MAX_WAITING)
        self._arrived = asyncio.Event()

    def put(self, payload: bytes) -> None:
        self._waiting.append(payload)
        self._arrived.set()

    async def take(self) -> bytes:
        while not self._waiting:
            self._arrived.clear()
            await self._arrived.wait()
        return self._waiting.popleft()


class _Watched:
    """A call that pages watch."""

    def __init__(self, relay: Relay, call: str) -> None:
        self.pages: set[_Page] = set()
        loop = asyncio.get_running_loop()

        def receive(payload: bytes) -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._hand_out, payload)

        self.call: WatchedCall = relay.watch(call, receive)

    def _hand_out(self, payload: bytes) -> None:
        for page in self.pages:
            page.put(payload)


class WatchServer:
    """Serves the pages of a relay while it is open; a context manager, with a thread of its own.

    port: TCP port, on all addresses of this host; 0: any free one.
    Raises `UserError` if the port is taken, or the page has not been built.
    """

    def __init__(self, relay: Relay, port: int) -> None:
        self._relay, self._calls = relay, dict[str, _Watched]()
        self._parts = _page_parts()
        self._loop = LoopThread()
        try:
            self.port = self._loop.run(self._open(port))
        except BaseException:
            self._loop.close()
            raise

    @property
    def pages(self) -> int:
        """How many pages watch."""
        return sum(len(watched.pages) for watched in self._calls.values())

    def close(self) -> None:
        """Stop listening."""
        self._loop.run(self._runner.cleanup())
        self._loop.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    async def _open(self, port: int) -> int:
        application = web.Application()
        for name in self._parts:
            application.router.add_get(f"/{name}", self._get_part)
        application.router.add_get("/{call}", self._get_page)
        application.router.add_get("/{call}/ws", self._get_socket)
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=0.5)
        await self._runner.setup()
        try:
            listening = _listening_socket(port)
        except OSError as error:
            await self._runner.cleanup()
            reason = bind_reason(error)
            raise UserError(f"cannot listen on port {port}: {reason}", LINK_FAILED) from error
        await web.SockSite(self._runner, listening).start()
        bound: int = listening.getsockname()[1]
        return bound

    async def _get_part(self, request: web.Request) -> web.Response:
        return _answer(self._parts[request.path.removeprefix("/")])

    async def _get_page(self, request: web.Request) -> web.Response:
        if not CALL_NAME.fullmatch(request.match_info["call"]):
            raise web.HTTPNotFound
        return _answer(self._parts[""])

    async def _get_socket(self, request: web.Request) -> web.WebSocketResponse:
        call = request.match_info["call"]
        if not CALL_NAME.fullmatch(call):
            raise web.HTTPNotFound
        if self.pages >= MAX_PAGES:
            raise web.HTTPServiceUnavailable
        stream = web.WebSocketResponse(
            max_msg_size=2 * MAX_MESSAGE_BYTES, heartbeat=20, compress=False
        )
        await stream.prepare(request)
        watched = self._calls.get(call)
        if watched is None:
            watched = self._calls[call] = _Watched(self._relay, call)
        page = _Page()
        watched.pages.add(page)
        sending = asyncio.create_task(_send(stream, page))
        try:
            async for message in stream:
                if message.type is WSMsgType.BINARY and len(message.data) <= MAX_MESSAGE_BYTES:
                    watched.call.send(message.data)
        finally:
            sending.cancel()
            watched.pages.discard(page)
            if not watched.pages and self._calls.get(call) is watched:
                del self._calls[call]
                await asyncio.to_thread(watched.call.close)
        return stream


def _listening_socket(port: int) -> socket.socket:
    """One for IPv4 and IPv6, where the system has both: two might get different free ports."""
    if socket.has_dualstack_ipv6():
        return socket.create_server(("", port), family=socket.AF_INET6, dualstack_ipv6=True)
    return socket.create_server(("", port))


async def _send(stream: web.WebSocketResponse, page: _Page) -> None:
    with suppress(ConnectionError):
        while True:
            await stream.send_bytes(await page.take())


def _page_parts() -> dict[str, tuple[bytes, str]]:
    """Body and media type of each part of the page, by its name.  Raises `UserError`."""
    player = files("player")
    try:
        script = (player / "built" / "watch.js").read_bytes()
    except FileNotFoundError as error:
        raise UserError(
            "the page that watches has not been built; run make player in the sources, it needs"
            " node"
        ) from error
    return {
        "": ((player / "watch" / "watch.html").read_bytes(), "text/html"),
        "letter.css": ((player / "letter" / "letter.css").read_bytes(), "text/css"),
        "watch.js": (script, "text/javascript"),
        "player.bin": ((player / "data" / "player.bin").read_bytes(), "application/octet-stream"),
    }


def _answer(part: tuple[bytes, str]) -> web.Response:
    body, kind = part
    charset = "utf-8" if kind.startswith("text/") else None
    return web.Response(body=body, content_type=kind, charset=charset, headers=HEADERS)
