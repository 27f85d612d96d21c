"""The server of a relay's watching pages.

/CALL         the page that watches a call; its key stands behind a #, which browsers do not send
/CALL/ws      payloads of the link, as a decoder gets and sends them: what they say the relay
              does not know

The page opens the payloads itself (`player/watch`).  A slow one loses the oldest that wait for it.
"""

import asyncio
import gzip
import hashlib
import secrets
import socket
from contextlib import suppress
from pathlib import PurePath
from typing import Self

from aiohttp import WSMsgType, web

from protocol.limits import CALL_NAME
from protocol.link.endpoints import bind_reason
from protocol.link.messages import MAX_MESSAGE_BYTES
from protocol.relay.zenoh_relay import Relay, WatchedCall
from risorius.page.access import HEADERS
from risorius.page.local_site import MEDIA_TYPES, Handler, answer
from risorius.page.loop_thread import LoopThread
from risorius.page.player_parts import WATCH_PAGE, WATCH_PARTS, player_part
from shared_model.errors import LINK_FAILED, UserError

# Payloads that may wait for a page; a model's pieces come many at a time.
MAX_WAITING = 512
# Of the name by which an encoder tells pages apart.
PAGE_BYTES = 6
# Pages at a time.
MAX_PAGES = 2000
# Of other pages the style sheets may be in the page, and pictures and sounds are made by scripts.
POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src data:;"
    " worker-src 'self'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'"
)
WATCH_HEADERS = {**HEADERS, "Content-Security-Policy": POLICY}
# Of a page, the payloads that it has not received yet.
_Waiting = asyncio.Queue[bytes]


class _Watched:
    """A call that pages watch."""

    def __init__(self, relay: Relay, call: str) -> None:
        self.pages: dict[str, _Waiting] = {}
        loop = asyncio.get_running_loop()

        def receive(payload: bytes, page: str) -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._hand_out, payload, page)

        self.call: WatchedCall = relay.watch(call, receive)

    def _hand_out(self, payload: bytes, page: str) -> None:
        """Give a payload to a page; "": to all."""
        meant = self.pages.values() if not page else filter(None, [self.pages.get(page)])
        for waiting in meant:
            if waiting.full():
                waiting.get_nowait()
            waiting.put_nowait(payload)


class WatchServer:
    """Serves the pages of a relay while it is open; a context manager, with a thread of its own.

    port: TCP port, on all addresses of this host; 0: any free one.
    Raises `UserError` if the port is taken, or the page has not been built.
    """

    def __init__(self, relay: Relay, port: int) -> None:
        self._relay, self._calls = relay, dict[str, _Watched]()
        self._page = player_part(WATCH_PAGE)
        self._parts = {PurePath(part).name: player_part(part) for part in WATCH_PARTS}
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
        for name, body in self._parts.items():
            handler = _kept(body, MEDIA_TYPES[PurePath(name).suffix])
            application.router.add_get(f"/{name}", handler)
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

    async def _get_page(self, request: web.Request) -> web.Response:
        if not CALL_NAME.fullmatch(request.match_info["call"]):
            raise web.HTTPNotFound
        return answer(self._page, MEDIA_TYPES[".html"], WATCH_HEADERS)

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
        # Other relays have pages of the call, too.
        page = secrets.token_urlsafe(PAGE_BYTES)
        waiting = watched.pages[page] = _Waiting(MAX_WAITING)
        sending = asyncio.create_task(_send(stream, waiting))
        try:
            async for message in stream:
                if message.type is WSMsgType.BINARY and len(message.data) <= MAX_MESSAGE_BYTES:
                    watched.call.send(message.data, page)
        finally:
            sending.cancel()
            del watched.pages[page]
            if not watched.pages and self._calls.get(call) is watched:
                del self._calls[call]
                await asyncio.to_thread(watched.call.close)
        return stream


def _kept(body: bytes, content_type: str) -> Handler:
    """What answers with a part that browsers keep: compressed, and only where it has changed."""
    packed, tag = gzip.compress(body), hashlib.sha256(body).hexdigest()[:16]
    headers = {**WATCH_HEADERS, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}

    async def handle(request: web.Request) -> web.Response:
        is_packed = "gzip" in request.headers.get("Accept-Encoding", "")
        if any(each.value == tag for each in request.if_none_match or ()):
            response = web.Response(status=304, headers=headers)
        elif is_packed:
            encoding = {"Content-Encoding": "gzip"}
            response = answer(packed, content_type, headers | encoding)
        else:
            response = answer(body, content_type, headers)
        response.etag = tag
        return response

    return handle


def _listening_socket(port: int) -> socket.socket:
    """One for IPv4 and IPv6, where the system has both: two might get different free ports."""
    if socket.has_dualstack_ipv6():
        return socket.create_server(("", port), family=socket.AF_INET6, dualstack_ipv6=True)
    return socket.create_server(("", port))


async def _send(stream: web.WebSocketResponse, waiting: _Waiting) -> None:
    with suppress(ConnectionError):
        while True:
            await stream.send_bytes(await waiting.get())
