"""Pictures of `stream.mjpg` are whole, whatever is drawn meanwhile and whenever the call ends."""

import asyncio
from collections.abc import Iterator
from urllib.request import urlopen

import cv2
import numpy as np
import pytest
from processes import LIMIT_S

from runtime.image_ops import jpeg
from shared_model.arrays import Picture

aiohttp = pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from risorius.call_page.messages import PictureMessage, Stream  # noqa: E402
from risorius.call_page.page_server import PageServer  # noqa: E402
from risorius.call_page.page_thread import PageThread  # noqa: E402

COUNT, STEP = 20, 12
# Of noise: more than a connection takes before somebody reads.
LARGE = 1080, 1920, 3


def pictures_of(stream: bytes) -> Iterator[Picture]:
    """The pictures of a stream that has ended; fails if one is cut off."""
    nothing, *parts = stream.split(b"--picture\r\n")
    assert nothing == b"" and parts.pop() == b""
    for part in parts:
        head, _, jpeg = part.removesuffix(b"\r\n").partition(b"\r\n\r\n")
        assert f"Content-Length: {len(jpeg)}".encode() in head
        assert jpeg.startswith(b"\xff\xd8") and jpeg.endswith(b"\xff\xd9")
        yield np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def test_a_picture_that_is_drawn_over_is_shown_as_it_was() -> None:
    buffer = np.zeros((48, 64, 3), np.uint8)
    with PageThread(0) as page:
        stream = urlopen(page.address + "stream.mjpg", timeout=LIMIT_S)
        for index in range(COUNT):
            buffer[:] = STEP * index
            page.show(index, index / 25, buffer, frozen=False, lost=False)
            buffer[:24] = 255
    with stream:
        shown = list(pictures_of(stream.read()))
    assert all(np.ptp(picture) < 3 for picture in shown)
    assert [round(int(picture[0, 0, 0]) / STEP) for picture in shown] == list(range(COUNT))


def test_a_picture_on_its_way_when_the_call_ends_is_whole() -> None:
    noise = jpeg(np.random.default_rng(1).integers(0, 256, LARGE, np.uint8))

    async def read() -> bytes:
        async with PageServer(patience_s=LIMIT_S) as page, aiohttp.ClientSession() as client:
            await page.open(0)
            async with client.get(page.address + "stream.mjpg") as answer:
                for index in range(COUNT):
                    page.audience.show(PictureMessage(Stream.OTHER, index, index / 25, 0, noise))
                first = await answer.content.readexactly(len(noise) // 2)
                closing = asyncio.create_task(page.close())
                # Raises an error of the client if the stream is cut off.
                rest = await answer.content.read()
                await closing
                return bytes(first + rest)

    shown = list(pictures_of(asyncio.run(asyncio.wait_for(read(), LIMIT_S))))
    assert 1 <= len(shown) < COUNT and all(picture.shape == LARGE for picture in shown)
