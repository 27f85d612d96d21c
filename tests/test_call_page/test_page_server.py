"""The page's server over real sockets: what watchers get, and who gets nothing."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from processes import LIMIT_S

aiohttp = pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from risorius.call_page.audience import MAX_WAITING, Audience, Watcher  # noqa: E402
from risorius.call_page.messages import (  # noqa: E402
    PictureMessage,
    Stream,
    parse_picture,
    serialise_picture,
)
from risorius.call_page.page_server import PageServer  # noqa: E402
from shared_model.errors import UserError  # noqa: E402

Test = Callable[[PageServer, Any], Awaitable[None]]


def picture(index: int, stream: Stream = Stream.OTHER) -> PictureMessage:
    return PictureMessage(stream, index, index / 25, 0, b"\xff\xd8%d" % index)


def run(test: Test, **callbacks: Any) -> None:
    """Run `test` with an open page and a client."""

    async def main() -> None:
        async with PageServer(**callbacks) as page, aiohttp.ClientSession() as client:
            await page.open(0)
            await test(page, client)

    asyncio.run(asyncio.wait_for(main(), LIMIT_S))


def origin(page: PageServer) -> dict[str, str]:
    return {"Origin": page.address.rsplit("/", 2)[0]}


async def websocket(page: PageServer, client: Any) -> Any:
    return await client.ws_connect(page.address + "ws", headers=origin(page))


def test_each_page_gets_pictures_and_states_and_a_late_one_the_newest() -> None:
    async def test(page: PageServer, client: Any) -> None:
        first = await websocket(page, client)
        page.tell("state", text="hello")
        assert await first.receive_json() == {"kind": "state", "text": "hello"}
        for index in range(3):
            page.audience.show(picture(index))
            assert parse_picture(await first.receive_bytes()) == picture(index)
        second = await websocket(page, client)
        assert (await second.receive_json())["text"] == "hello"
        assert parse_picture(await second.receive_bytes()) == picture(2)

    run(test)


def test_a_page_sends_commands_and_its_camera_and_nonsense_does_no_harm() -> None:
    commands, camera = list[Any](), list[PictureMessage]()

    async def test(page: PageServer, client: Any) -> None:
        socket = await websocket(page, client)
        await socket.send_str("{")
        for nonsense in ("[1]", "{}", '{"kind": []}', 100_000 * "["):
            await socket.send_str(nonsense)
        await socket.send_bytes(b"\x03")
        await socket.send_bytes(serialise_picture(picture(1, Stream.OTHER)))
        await socket.send_bytes(serialise_picture(picture(2, Stream.CAMERA)))
        await socket.send_str('{"kind": "mute"}')
        while not commands:
            await asyncio.sleep(0.01)

    run(test, on_command=commands.append, on_camera=camera.append)
    assert commands == [{"kind": "mute"}] and camera == [picture(2, Stream.CAMERA)]


def test_other_programs_get_the_other_persons_pictures_as_motion_jpeg() -> None:
    async def test(page: PageServer, client: Any) -> None:
        async with client.get(page.address + "stream.mjpg") as answer:
            assert answer.content_type == "multipart/x-mixed-replace"
            page.audience.show(picture(7, Stream.SELF))
            page.audience.show(picture(8))
            head = await answer.content.readuntil(b"\r\n\r\n")
            assert b"image/jpeg" in head and b"Content-Length: 3" in head
            assert await answer.content.readexactly(3) == picture(8).jpeg

    run(test)


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("", {"Host": "evil.example"}),
        ("stream.mjpg", {"Origin": "http://evil.example"}),
        ("ws", {"Origin": "http://127.0.0.1:1"}),
        ("../wrong/", {}),
        ("../", {}),
    ],
)
def test_who_comes_from_elsewhere_or_guesses_gets_nothing(
    path: str, headers: dict[str, str]
) -> None:
    async def test(page: PageServer, client: Any) -> None:
        page.audience.show(picture(1))
        async with client.get(page.address + path, headers=headers) as answer:
            assert answer.status == 403 and len(await answer.read()) < 60

    run(test)


def test_the_page_needs_nothing_from_elsewhere_and_may_not_be_framed() -> None:
    async def test(page: PageServer, client: Any) -> None:
        async with client.get(page.address) as answer:
            body = await answer.read()
            assert answer.content_type == "text/html" and b"https://" not in body
            assert b"http://" not in body.replace(b"http://www.w3.org/2000/svg", b"")
            policy = answer.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy

    run(test)


def test_a_port_in_use_is_told() -> None:
    async def test(page: PageServer, client: Any) -> None:
        port = int(page.address.split(":")[2].split("/")[0])
        with pytest.raises(UserError, match="try another --port"):
            await PageServer().open(port)

    run(test)


def test_who_is_slow_loses_the_oldest_pictures_of_a_stream_and_older_states() -> None:
    async def test() -> list[object]:
        watcher = Watcher()
        watcher.put(picture(0, Stream.SELF))
        for index in range(MAX_WAITING + 5):
            watcher.put(picture(index))
            watcher.put_text("costs", f"{index} bit/s")
            watcher.put_text("state", "" if index else "calling")
        return [await watcher.take() for _ in range(MAX_WAITING + 3)]

    taken = asyncio.run(test())
    shown = [m.index for m in taken if isinstance(m, PictureMessage) and m.stream is Stream.OTHER]
    assert shown == list(range(5, MAX_WAITING + 5)) and taken[0] == picture(0, Stream.SELF)
    assert [each for each in taken if isinstance(each, str)] == [f"{MAX_WAITING + 4} bit/s", ""]


def test_who_has_left_is_no_longer_counted() -> None:
    audience = Audience()
    with audience.watching():
        assert len(audience) == 1
    assert len(audience) == 0
