"""The server of a call's page: the page itself, its WebSocket, and a stream for other programs.

/TOKEN/               the page; with ?window=1 nothing but the picture, for OBS and the like
/TOKEN/ws             pictures and state to the page; camera, sound and commands from it; after the
                      command `draws` faces and models instead of pictures: the page draws
/TOKEN/face_drawer.js, /TOKEN/player.bin
                      what draws them
/TOKEN/stream.mjpg    the other person's pictures as Motion JPEG
"""

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from protocol.errors import ProtocolError
from risorius.call_page.audience import Audience, Watcher
from risorius.call_page.face_message import (
    FaceMessage,
    ModelMessage,
    serialise_face,
    serialise_model_message,
)
from risorius.call_page.messages import (
    MAX_JPEG_BYTES,
    PictureMessage,
    SoundMessage,
    Stream,
    parse_message,
    serialise_message,
)
from risorius.page.access import HEADERS
from risorius.page.local_site import LocalSite, page_files, player_files

FILES = (
    *("call.css", "call.js", "player.js", "voice.js", "voice_worklet.js"),
    *("tape.js", "devices.js", "camera_worker.js"),
)
BOUNDARY = "picture"
# The command of a page that draws faces.
DRAWS = "draws"
PATIENCE_S = 0.5
CommandCallback = Callable[[dict[str, Any]], None]
CameraCallback = Callable[[PictureMessage], None]
SoundCallback = Callable[[SoundMessage], None]


class PageServer:
    """Serves one call's page on this host while it is open; used in one event loop.

    audience: all pages and programs that watch: what they are shown goes to it.
    on_command: called with each command of a page; its `kind` is a string.
    on_camera, on_sound: called with each picture of a page's camera and each piece of sound of its
        microphone; of several pages one gives these at a time.  None: there are none.
    on_need: called with whether a page or a program needs pictures, since it cannot draw faces.
    patience_s: how long it waits at most, when it closes, for pages to leave and for a picture that
        is on its way.
    """

    def __init__(
        self,
        on_command: CommandCallback | None = None,
        on_camera: CameraCallback | None = None,
        on_sound: SoundCallback | None = None,
        patience_s: float = PATIENCE_S,
        on_need: Callable[[bool], None] = lambda is_needed: None,
    ) -> None:
        self.audience = Audience(on_need)
        self._on_command, self._on_camera, self._on_sound = on_command, on_camera, on_sound
        self._giving: web.WebSocketResponse | None = None  # whose camera and microphone are used
        self._sockets: set[web.WebSocketResponse] = set()
        self._patience_s, self._all_left = patience_s, asyncio.Event()
        self._all_left.set()
        self._site = LocalSite(
            {
                **page_files("risorius.call_page", "call.html", FILES),
                **player_files(),
                ("GET", "ws"): self._get_socket,
                ("GET", "stream.mjpg"): self._get_stream,
            },
            patience_s,
        )

    @property
    def address(self) -> str:
        """The address of the page, with its secret part."""
        return self._site.address

    async def open(self, port: int) -> None:
        """Listen on this TCP port; 0: any free one.  Raises `UserError` if it is taken."""
        await self._site.open(port)

    async def close(self) -> None:
        """Say goodbye to all pages and stop listening."""
        # A page leaves by itself: a server that closes while a camera's picture is on its way
        # resets the connection, and the page may never read why.
        self.tell("ended")
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._all_left.wait(), self._patience_s)
        for socket in list(self._sockets):
            await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the call has ended")
        # A stream ends after the picture that is on its way.
        self.audience.end()
        await self._site.close()

    def tell(self, kind: str, **content: Any) -> None:
        """Send a state to all pages, see `Audience.tell`."""
        self.audience.tell(kind, json.dumps({"kind": kind, **content}))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()

    async def _get_stream(self, request: web.Request) -> web.StreamResponse:
        kind = f"multipart/x-mixed-replace; boundary={BOUNDARY}"
        answer = web.StreamResponse(headers={**HEADERS, "Content-Type": kind})
        await answer.prepare(request)
        boundary = f"--{BOUNDARY}\r\n".encode()
        with self.audience.watching() as watcher, suppress(ConnectionError):
            await answer.write(boundary)
            while (message := await watcher.take()) is not None:
                if isinstance(message, PictureMessage) and message.stream is Stream.OTHER:
                    size = f"Content-Length: {len(message.jpeg)}\r\n\r\n"
                    head = f"Content-Type: image/jpeg\r\n{size}".encode()
                    # Browsers show a picture when they have the boundary after it.
                    await answer.write(head + message.jpeg + b"\r\n" + boundary)
        return answer

    async def _get_socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(
            # What is sent is compressed already.
            max_msg_size=2 * MAX_JPEG_BYTES,
            heartbeat=20,
            compress=False,
        )
        await socket.prepare(request)
        self._sockets.add(socket)
        self._all_left.clear()
        try:
            with self.audience.watching() as watcher:
                sending = asyncio.create_task(_send(socket, watcher))
                try:
                    async for message in socket:
                        await self._receive(socket, watcher, message)
                finally:
                    sending.cancel()
        finally:
            self._sockets.discard(socket)
            if not self._sockets:
                self._all_left.set()
            if self._giving is socket:
                self._giving = None
        return socket

    async def _receive(
        self, socket: web.WebSocketResponse, watcher: Watcher, message: WSMessage
    ) -> None:
        """Take a page's message; one that is damaged is left out."""
        with suppress(ProtocolError, ValueError, RecursionError):
            if message.type is WSMsgType.BINARY:
                await self._take(socket, parse_message(message.data))
            elif message.type is WSMsgType.TEXT:
                command = json.loads(message.data)
                if not isinstance(command, dict) or not isinstance(command.get("kind"), str):
                    return
                if command["kind"] == DRAWS:
                    self.audience.let_draw(watcher)
                elif self._on_command is not None:
                    self._on_command(command)

    async def _take(
        self, socket: web.WebSocketResponse, message: PictureMessage | SoundMessage
    ) -> None:
        """Take what a page's camera or microphone gives."""
        if message.stream not in (Stream.CAMERA, Stream.MICROPHONE):
            return
        self._giving = self._giving or socket
        if self._giving is not socket:
            await socket.send_str(json.dumps({"kind": "busy"}))
        elif isinstance(message, SoundMessage):
            if self._on_sound is not None:
                self._on_sound(message)
        elif self._on_camera is not None:
            self._on_camera(message)


async def _send(socket: web.WebSocketResponse, watcher: Watcher) -> None:
    """Send what a watcher gets until the page closes."""
    with suppress(ConnectionError):
        while (message := await watcher.take()) is not None:
            if isinstance(message, str):
                await socket.send_str(message)
            elif isinstance(message, FaceMessage):
                await socket.send_bytes(serialise_face(message))
            elif isinstance(message, ModelMessage):
                await socket.send_bytes(serialise_model_message(message))
            else:
                await socket.send_bytes(serialise_message(message))
