"""The pages and programs that watch a call, each with a queue of its own.

A slow one loses pictures and older states; it delays neither the call nor another one.
"""

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from risorius.call_page.messages import PictureMessage, SoundMessage, Stream

# Messages of each stream that may wait for one watcher: a packet's eight pictures come at once.
MAX_WAITING = 24
# How often it is looked whether anything still waits.
NAP_S = 0.01

Message = PictureMessage | SoundMessage | str


class Watcher:
    """What one page has not received yet: some pictures and sounds, of each kind of text one."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Stream | str, Message]] = deque()  # with the stream or kind
        self._arrived = asyncio.Event()
        self._has_ended = False

    def put(self, message: PictureMessage | SoundMessage) -> None:
        """Add a picture or sound; if there are too many of its stream, the oldest goes."""
        self._put(message.stream, message, MAX_WAITING)

    def put_text(self, kind: str, text: str) -> None:
        """Add a text instead of the one of its kind that waits."""
        self._put(kind, text, 1)

    def _put(self, key: Stream | str, message: Message, limit: int) -> None:
        same = [waiting for waiting in self._waiting if waiting[0] == key]
        if len(same) >= limit:
            self._waiting.remove(same[0])
        self._waiting.append((key, message))
        self._arrived.set()

    @property
    def is_waiting(self) -> bool:
        """Whether something has not been taken yet."""
        return bool(self._waiting)

    def end(self) -> None:
        """Nothing comes any more, and what still waits is left out."""
        self._waiting.clear()
        self._has_ended = True
        self._arrived.set()

    async def take(self) -> Message | None:
        """Wait for the next message; None: the call's page has been closed."""
        while not self._waiting:
            if self._has_ended:
                return None
            self._arrived.clear()
            await self._arrived.wait()
        return self._waiting.popleft()[1]


class Audience:
    """All watchers of a call; used in one event loop.

    A new one first gets the newest picture of each stream and the newest text of each kind.
    """

    def __init__(self) -> None:
        self._watchers: list[Watcher] = []
        self._pictures: dict[Stream, PictureMessage] = {}
        self._texts: dict[str, str] = {}
        self._joined = asyncio.Event()

    def __len__(self) -> int:
        return len(self._watchers)

    def show(self, picture: PictureMessage) -> None:
        """Send a picture to all."""
        self._pictures[picture.stream] = picture
        for watcher in self._watchers:
            watcher.put(picture)

    def play(self, sound: SoundMessage) -> None:
        """Send a piece of sound to all."""
        for watcher in self._watchers:
            watcher.put(sound)

    def tell(self, kind: str, text: str) -> None:
        """Send a text to all; who joins later gets the newest of its kind."""
        self._texts[kind] = text
        for watcher in self._watchers:
            watcher.put_text(kind, text)

    def end(self) -> None:
        """Tell all that nothing comes any more."""
        for watcher in self._watchers:
            watcher.end()

    async def emptied(self) -> None:
        """Wait until all have taken what was sent to them."""
        while any(watcher.is_waiting for watcher in self._watchers):
            await asyncio.sleep(NAP_S)

    async def joined(self) -> None:
        """Wait for the first watcher."""
        await self._joined.wait()

    @contextmanager
    def watching(self) -> Iterator[Watcher]:
        """A watcher for the time of the `with` block."""
        watcher = Watcher()
        for kind, text in self._texts.items():
            watcher.put_text(kind, text)
        for picture in self._pictures.values():
            watcher.put(picture)
        self._watchers.append(watcher)
        self._joined.set()
        try:
            yield watcher
        finally:
            self._watchers.remove(watcher)
