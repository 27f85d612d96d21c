"""The pages and programs that watch a call, each with a queue of its own.

A slow one loses pictures and older states; it delays neither the call nor another one.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain

from risorius.call_page.face_message import FaceMessage, ModelMessage
from risorius.call_page.messages import PictureMessage, SoundMessage, Stream

# Messages of each stream that may wait for one watcher: a packet's eight pictures come at once.
MAX_WAITING = 24
# Faces are small, and a recorded call is kept by the page.
MAX_WAITING_FACES = 512
# How often it is looked whether anything still waits.
NAP_S = 0.01

# Models of a stream that a watcher who joins gets: that in use and the next, with more and fewer
# layers.
KEPT_MODELS = 3

Message = PictureMessage | FaceMessage | ModelMessage | SoundMessage | str


class Watcher:
    """What one page has not received yet: some pictures and sounds, of each kind of text one.

    draws: it gets faces and models, all of these, and draws them; else it gets pictures.
    """

    def __init__(self) -> None:
        self.draws = False
        self._waiting: deque[tuple[Stream | str, Message]] = deque()  # with the stream or kind
        self._arrived = asyncio.Event()
        self._has_ended = False

    def put(self, message: PictureMessage | FaceMessage | SoundMessage) -> None:
        """Add a picture, face or sound; if there are too many of its stream, the oldest goes."""
        is_face = isinstance(message, FaceMessage)
        self._put(message.stream, message, MAX_WAITING_FACES if is_face else MAX_WAITING)

    def put_model(self, message: ModelMessage) -> None:
        """Add a model."""
        self._put("model", message, MAX_WAITING)

    def put_text(self, kind: str, text: str) -> None:
        """Add a text; it replaces a waiting text of the same kind."""
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
    on_need: called with whether somebody needs pictures, when that changes.
    """

    def __init__(self, on_need: Callable[[bool], None] = lambda is_needed: None) -> None:
        self._watchers: list[Watcher] = []
        self._on_need, self._needs_pictures = on_need, False
        self._pictures: dict[Stream, PictureMessage] = {}
        self._faces: dict[Stream, FaceMessage] = {}
        self._models: dict[Stream, deque[ModelMessage]] = {}
        self._texts: dict[str, str] = {}
        self._joined = asyncio.Event()

    def __len__(self) -> int:
        return len(self._watchers)

    def show(self, picture: PictureMessage) -> None:
        """Send a picture to all."""
        self._pictures[picture.stream] = picture
        for watcher in self._watchers:
            if not watcher.draws:
                watcher.put(picture)

    def show_face(self, face: FaceMessage) -> None:
        """Send a face to all who draw."""
        self._faces[face.stream] = face
        for watcher in self._watchers:
            if watcher.draws:
                watcher.put(face)

    def show_model(self, model: ModelMessage) -> None:
        """Send a model to all who draw."""
        self._models.setdefault(model.stream, deque(maxlen=KEPT_MODELS)).append(model)
        for watcher in self._watchers:
            if watcher.draws:
                watcher.put_model(model)

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

    def let_draw(self, watcher: Watcher) -> None:
        """From now on a watcher gets faces and models instead of pictures."""
        watcher.draws = True
        for model in chain.from_iterable(self._models.values()):
            watcher.put_model(model)
        for face in self._faces.values():
            watcher.put(face)
        self._tell_need()

    @contextmanager
    def watching(self) -> Iterator[Watcher]:
        """A watcher for the time of the `with` block."""
        watcher = Watcher()
        for kind, text in self._texts.items():
            watcher.put_text(kind, text)
        for picture in self._pictures.values():
            watcher.put(picture)
        self._watchers.append(watcher)
        self._tell_need()
        self._joined.set()
        try:
            yield watcher
        finally:
            self._watchers.remove(watcher)
            self._tell_need()

    def _tell_need(self) -> None:
        is_needed = any(not watcher.draws for watcher in self._watchers)
        if is_needed != self._needs_pictures:
            self._needs_pictures = is_needed
            self._on_need(is_needed)
