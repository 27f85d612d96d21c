"""A page of a call without a browser: what it is sent.  Needs aiohttp."""

import asyncio
import json
from contextlib import suppress
from dataclasses import dataclass, field
from threading import Thread
from typing import Any, Self
from urllib.parse import urlsplit

import aiohttp
import numpy as np

from risorius.call_page.messages import (
    PictureMessage,
    SoundMessage,
    Stream,
    parse_message,
)


@dataclass
class Watcher:
    """A page of the other end without a browser: what it is sent.

    loudness: of the decoded voice, the greatest of a piece.
    """

    address: str
    states: list[dict[str, Any]] = field(default_factory=list)
    pictures: list[PictureMessage] = field(default_factory=list)
    loudness: float = 0.0

    def __enter__(self) -> Self:
        Thread(target=lambda: asyncio.run(self._watch()), daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        """Nothing to do: the watcher ends with the page."""

    async def _watch(self) -> None:
        parts = urlsplit(self.address)
        headers = {"Origin": f"http://{parts.netloc}"}
        with suppress(aiohttp.ClientError):
            async with aiohttp.ClientSession() as client:
                url = self.address + "ws"
                async with client.ws_connect(url, headers=headers, max_msg_size=1 << 24) as socket:
                    async for message in socket:
                        self._receive(message.data)

    def _receive(self, data: str | bytes) -> None:
        if isinstance(data, str):
            self.states.append(json.loads(data))
            return
        message = parse_message(data)
        if isinstance(message, SoundMessage):
            samples = np.frombuffer(message.samples, np.int16).astype(float)
            self.loudness = max(self.loudness, float(samples.std()))
        elif message.stream is Stream.OTHER:
            self.pictures.append(message)

    def said(self, kind: str, name: str, value: object) -> bool:
        """Whether the newest message of a kind says so."""
        of_kind = [each for each in self.states if each["kind"] == kind]
        return bool(of_kind) and of_kind[-1].get(name) == value
