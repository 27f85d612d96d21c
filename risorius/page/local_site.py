"""A site on a TCP port of this host, for programs that know its address."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import PurePath
from typing import Any, Self

from aiohttp import web

from protocol.link.endpoints import bind_reason
from risorius.page.access import HEADERS, HOST, Access, not_served, random_token
from risorius.page.player_parts import player_part
from shared_model.errors import UserError

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
# Bytes of a request's body at most: every command of a page takes less.
MAX_BODY_BYTES = 1 << 16
MEDIA_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".bin": "application/octet-stream",
}


class LocalSite:
    """Serves a page while it is open; used in one event loop.

    pages: what answers a request, by its method and its path below the secret part of the address,
        as in `("GET", "picture.jpg")`.  What raises `ValueError` or `UserError` is answered by
        that line.
    patience_s: how long it waits at most for answers that are on their way when it closes.
    """

    def __init__(self, pages: Mapping[tuple[str, str], Handler], patience_s: float = 0.0) -> None:
        self._access = Access(0, random_token())
        application = web.Application(middlewares=[self._checked], client_max_size=MAX_BODY_BYTES)
        for (method, path), handler in pages.items():
            application.router.add_route(method, f"/{{token}}/{path}", handler)
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=patience_s)

    @property
    def address(self) -> str:
        """The address of the page, with its secret part."""
        return self._access.address

    async def open(self, port: int) -> None:
        """Listen on this TCP port; 0: any free one.  Raises `UserError` if it is taken."""
        await self._runner.setup()
        site = web.TCPSite(self._runner, HOST, port)
        try:
            await site.start()
        except OSError as error:
            await self._runner.cleanup()
            raise not_served(port, bind_reason(error)) from error
        bound: int = self._runner.addresses[0][1]
        self._access = Access(bound, self._access.token)

    async def close(self) -> None:
        """Stop listening."""
        await self._runner.cleanup()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()

    @web.middleware
    async def _checked(self, request: web.Request, handler: Any) -> web.StreamResponse:
        is_websocket = request.headers.get("Upgrade", "").lower() == "websocket"
        token = request.path.split("/")[1]
        reason = self._access.refusal(request.headers, token, is_websocket)
        if reason is not None:
            return web.Response(status=403, text=f"{reason}\n", headers=HEADERS)
        try:
            answer: web.StreamResponse = await handler(request)
        except (ValueError, UserError) as error:
            return web.Response(status=400, text=f"{error}\n", headers=HEADERS)
        return answer


def answer(body: bytes, content_type: str, headers: Mapping[str, str] = HEADERS) -> web.Response:
    """An answer with a body of this media type."""
    charset = "utf-8" if content_type.startswith("text/") else None
    return web.Response(body=body, content_type=content_type, charset=charset, headers=headers)


def page_files(package: str, page: str, names: Sequence[str]) -> dict[tuple[str, str], Handler]:
    """A page of a package, its style sheets and scripts, and the script of all pages.

    page, names: of the files.
    """
    folder, of_all = files(package), files("risorius.page") / "element.js"
    parts = {"": folder / page, "element.js": of_all} | {name: folder / name for name in names}
    return {("GET", path): _file(part) for path, part in parts.items()}


def player_files() -> dict[tuple[str, str], Handler]:
    """What draws faces on a page, and its data."""
    script, data = player_part("built/face_drawer.js"), player_part("data/player.bin")
    return {
        ("GET", "face_drawer.js"): fixed(script, MEDIA_TYPES[".js"]),
        ("GET", "player.bin"): fixed(data, MEDIA_TYPES[".bin"]),
    }


def _file(part: Traversable) -> Handler:
    return fixed(part.read_bytes(), MEDIA_TYPES[PurePath(part.name).suffix])


def fixed(body: bytes, content_type: str, headers: Mapping[str, str] = HEADERS) -> Handler:
    """What answers every request with the same body."""

    async def handle(request: web.Request) -> web.Response:
        return answer(body, content_type, headers)

    return handle
