"""A call's page beside a program that decodes: the server runs in a thread of its own."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from risorius.call_page.face_message import FaceMessage, ModelMessage
from risorius.call_page.messages import PictureMessage, SoundMessage, Stream
from risorius.call_page.page_server import PageServer
from risorius.page.loop_thread import LoopThread
from runtime.image_ops import jpeg
from shared_model.arrays import Picture, Samples

# How often who waits for a page asks whether to stop, how long a slow page may take for the last
# pictures, and these to the screen.
NAP_S, LAST_S, LINGER_S = 0.1, 5.0, 0.5


class PageThread:
    """A page that shows pictures, or draws faces; a context manager.

    port: TCP port on this host; 0: any free one.
    needs_pictures: a page is there that does not draw faces.
    Raises `UserError` if the port is taken.
    """

    def __init__(self, port: int) -> None:
        self._loop, self.needs_pictures = LoopThread(), False
        try:
            self._server = self._loop.run(self._opened(port))
        except BaseException:
            self._loop.close()
            raise
        self._joined = self._loop.start(self._server.audience.joined())

    @property
    def address(self) -> str:
        """The address of the page."""
        return self._server.address

    def wait_for_page(self, stop: Callable[[], bool]) -> None:
        """Wait until somebody looks, or until `stop`."""
        while not self._joined.done() and not stop():
            time.sleep(NAP_S)

    def show(self, index: int, time_s: float, picture: Picture, frozen: bool, lost: bool) -> None:
        """Show a picture, (height, width, 3) uint8 BGR.

        index, time_s: of its source frame.  frozen: it repeats an older face; lost: since nothing
        has come.
        """
        data = jpeg(picture)
        message = PictureMessage(
            Stream.OTHER, index, time_s, 1000 * time.time(), data, frozen, lost
        )
        self._loop.call(self._server.audience.show, message)

    def show_face(self, face: FaceMessage) -> None:
        """Show a face on pages that draw."""
        self._loop.call(self._server.audience.show_face, face)

    def show_model(self, model: ModelMessage) -> None:
        """Give pages that draw a model."""
        self._loop.call(self._server.audience.show_model, model)

    def play(self, time_s: float, rate_hz: int, samples: Samples) -> None:
        """Play a voice, (n,) int16 at `rate_hz`; time_s: of its first sample in the source."""
        message = SoundMessage(Stream.VOICE, rate_hz, time_s, 0.0, samples.tobytes())
        self._loop.call(self._server.audience.play, message)

    def tell(self, kind: str, **content: Any) -> None:
        """Tell the page a state, see `PageServer.tell`."""
        self._loop.call(lambda: self._server.tell(kind, **content))

    def close(self) -> None:
        """Let the page show what it has, then end."""
        if self._joined.done():
            with suppress(TimeoutError):
                self._loop.run(asyncio.wait_for(self._server.audience.emptied(), LAST_S))
            time.sleep(LINGER_S)
        self._joined.cancel()
        self._loop.run(self._server.close())
        self._loop.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    async def _opened(self, port: int) -> PageServer:
        server = PageServer(on_need=self._need)
        await server.open(port)
        return server

    def _need(self, is_needed: bool) -> None:
        self.needs_pictures = is_needed
