"""The pages of a measurement, all in one process: the decoder's end of a link, no pictures."""

import asyncio
import json
import secrets
import sys
import time
from collections.abc import Sequence

import aiohttp

from protocol.errors import ProtocolError
from protocol.limits import SESSION_BYTES
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.link_protection import PlainProtection
from protocol.packets import PacketKind, packet_kind

TICK_S = 0.05


class _Page:
    """What one page has received; came: number and time of each frame packet."""

    def __init__(self) -> None:
        self._guard = PlainProtection(secrets.token_bytes(SESSION_BYTES), is_encoder=False)
        self._receiver = DeliveryReceiver(self._guard.session, self._guard.on_peer)
        self.came: list[tuple[int, float]] = []
        self.has_model = asyncio.Event()

    async def watch(self, http: aiohttp.ClientSession, address: str) -> None:
        async with http.ws_connect(address) as socket:
            while True:
                for payload in self._receiver.payloads(time.monotonic()):
                    await socket.send_bytes(self._guard.protect(payload))
                try:
                    message = await socket.receive(TICK_S)
                except TimeoutError:
                    continue
                if message.type is not aiohttp.WSMsgType.BINARY:
                    return
                self._receive(message.data)

    def _receive(self, payload: bytes) -> None:
        data = self._guard.unprotect(payload)
        if data is None:
            return
        now_s = time.monotonic()
        try:
            arrivals = self._receiver.receive(data, now_s)
        except ProtocolError:
            return
        for arrival in arrivals:
            if packet_kind(arrival.data) is PacketKind.MODEL:
                self.has_model.set()
            elif arrival.number is not None:
                self.came.append((arrival.number, now_s))


async def _watch(address: str, number: int, a_second: float) -> list[tuple[int, float]]:
    pages = [_Page() for _ in range(number)]
    connector = aiohttp.TCPConnector(limit=0)
    async with aiohttp.ClientSession(connector=connector) as http:
        tasks = []
        for page in pages:
            tasks.append(asyncio.create_task(page.watch(http, address)))
            await asyncio.sleep(1 / a_second)
        print("open", flush=True)
        await asyncio.gather(*(page.has_model.wait() for page in pages))
        print("all have the model", flush=True)
        await asyncio.to_thread(sys.stdin.read)
        for task in tasks:
            task.cancel()
    return [each for page in pages for each in page.came]


def main(arguments: Sequence[str]) -> None:
    """PORT CALL PAGES PAGES_A_SECOND: say when all are open and have the model, print what came."""
    port, call, number, a_second = arguments
    address = f"ws://127.0.0.1:{port}/{call}/ws"
    came = asyncio.run(_watch(address, int(number), float(a_second)))
    print(json.dumps(came), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
