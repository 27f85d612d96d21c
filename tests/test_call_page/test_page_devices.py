"""The page of a call in Chromium: devices, a computer that is too slow, states, looks."""

import asyncio
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from processes import LIMIT_S

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from benchmarks.browser import Browser
from benchmarks.played_letter import SOFTWARE_GL
from risorius.call_page.messages import PictureMessage, SoundMessage, Stream
from risorius.call_page.page_server import PageServer
from runtime.image_ops import jpeg

SETUP = {
    **{"call": "anna", "camera": True, "microphone_hz": 16000, "has_voice": True},
    **{"has_face": False, "mute": False, "camera_off": False, "face": False, "recording": False},
}


class Page:
    """A page server in a thread; what the page gives is counted."""

    def __init__(self) -> None:
        self.pictures: list[PictureMessage] = []
        self.sounds: list[SoundMessage] = []
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self.server = self._run(self._open())

    async def _open(self) -> PageServer:
        server = PageServer(lambda command: None, self.pictures.append, self.sounds.append, LIMIT_S)
        await server.open(0)
        return server

    def _run(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(LIMIT_S)

    def tell(self, kind: str, **content: Any) -> None:
        async def work() -> None:
            self.server.tell(kind, **content)

        self._run(work())

    def show(self, stream: Stream, index: int, jpeg: bytes) -> None:
        async def work() -> None:
            self.server.audience.show(
                PictureMessage(stream, index, index / 25, 1000 * time.time(), jpeg)
            )

        self._run(work())

    def close(self) -> None:
        self._run(self.server.close())


@pytest.fixture
def page() -> Iterator[Page]:
    opened = Page()
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, chromium: str) -> Iterator[Browser]:
    flags = ("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream")
    with Browser(chromium, tmp_path_factory.mktemp("browser"), 900, 600, *flags) as opened:
        yield opened


def open_page(browser: Browser, page: Page, before: str = "") -> None:
    browser.call("Page.enable")
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=before or "0")
    browser.call("Page.navigate", url=page.server.address)
    browser.wait("typeof players != 'undefined' && socket.readyState === WebSocket.OPEN")
    number = script["identifier"]
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=number)


def wait_for(condition: Any) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def without(kind: str, error: str) -> str:
    """Script by which a page has no camera ("video") or no microphone ("audio") while `denied`."""
    return f"""
    window.denied = true;
    const real = navigator.mediaDevices.getUserMedia.bind(navigator.mediaDevices);
    navigator.mediaDevices.getUserMedia = async wanted => {{
      if (wanted.{kind} && window.denied) throw new DOMException("no", "{error}");
      return real(wanted);
    }};
    """


@pytest.mark.parametrize(
    ("kind", "error", "reason"),
    [
        ("audio", "NotFoundError", "There is no microphone."),
        ("video", "NotAllowedError", "The browser may not use the camera: allow it."),
    ],
)
def test_one_device_that_is_missing_does_not_take_the_other(
    browser: Browser, page: Page, kind: str, error: str, reason: str
) -> None:
    open_page(browser, page, without(kind, error))
    page.tell("setup", **SETUP)
    missing, other = (page.sounds, page.pictures)[:: 1 if kind == "audio" else -1]
    wait_for(lambda: len(other) > 3)
    browser.wait("!el('missing').hidden")
    assert browser.value("el('reasons').textContent") == reason and not missing
    browser.value("window.denied = false")
    browser.click("#retry")
    wait_for(lambda: len(missing) > 3)
    browser.wait("el('missing').hidden")


def test_the_camera_goes_on_where_nothing_is_drawn_and_its_pictures_are_whole(
    browser: Browser, page: Page
) -> None:
    """As in a tab that is hidden: no frames of the screen, and timers that sleep."""
    asleep = (
        "HTMLVideoElement.prototype.requestVideoFrameCallback = () => 0;"
        "window.requestAnimationFrame = () => 0;"
    )
    open_page(browser, page, asleep)
    page.tell("setup", **SETUP)
    wait_for(lambda: len(page.pictures) > 20)
    data = np.frombuffer(page.pictures[-1].jpeg, np.uint8)
    assert np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR)).shape == (480, 640, 3)


def test_a_camera_that_stops_is_opened_again_and_said(browser: Browser, page: Page) -> None:
    open_page(browser, page)
    page.tell("setup", **SETUP)
    wait_for(lambda: len(page.pictures) > 3)
    browser.value("devices.camera.getTracks()[0].onended()")
    assert "The camera has stopped" in browser.value("el('reasons').textContent")
    seen = len(page.pictures)
    browser.wait("el('missing').hidden")
    wait_for(lambda: len(page.pictures) > seen + 3)


def test_one_sees_oneself_at_once_as_in_a_mirror_then_as_the_others_do(
    browser: Browser, page: Page
) -> None:
    open_page(browser, page)
    page.tell("setup", **SETUP)
    browser.wait("!el('camera').hidden && el('camera').videoWidth > 0 && el('self').hidden")
    assert "-1" in browser.value("getComputedStyle(el('camera')).transform")
    grey = jpeg(np.full((48, 64, 3), 90, np.uint8))
    page.show(Stream.SELF, 0, grey)
    browser.wait("el('camera').hidden && !el('self').hidden")


def test_a_computer_that_is_too_slow_leaves_pictures_out_and_says_so(
    browser: Browser, page: Page
) -> None:
    slow = """
    const quick = createImageBitmap;
    window.createImageBitmap = async blob => {
      await new Promise(done => setTimeout(done, 250));
      return quick(blob);
    };
    """
    open_page(browser, page, slow)
    data = jpeg(np.full((48, 64, 3), 90, np.uint8))
    begin = time.monotonic()
    for index in range(200):
        page.show(Stream.OTHER, index, data)
        time.sleep(max(0.0, begin + index / 25 - time.monotonic()))
    assert browser.value("players[OTHER].leftOut") > 50
    assert browser.value("players[OTHER].coded.length") <= 24
    waits = browser.value("players[OTHER].log.slice(-5).map(each => each[1] - each[2])")
    assert max(waits) < 4000
    browser.wait("!el('note').hidden && el('note').textContent.includes('too slow')")


@pytest.mark.parametrize("is_software", [True, False], ids=["software", "no WebGL"])
def test_a_page_without_a_graphics_card_says_that_the_program_draws(
    is_software: bool, page: Page, chromium: str, tmp_path: Path
) -> None:
    flags = SOFTWARE_GL if is_software else ("--disable-3d-apis",)
    with Browser(chromium, tmp_path / "b", 800, 600, *flags) as browser:
        open_page(browser, page)
        has_webgl = "document.createElement('canvas').getContext('webgl2') !== null"
        assert browser.value(has_webgl) == is_software
        page.tell("faces")
        browser.wait("!el('news').hidden")
        assert "risorius draws" in browser.value("el('news').textContent")
        assert browser.value("players[OTHER].drawer === null")


def test_a_call_that_has_ended_has_no_live_buttons(browser: Browser) -> None:
    page = Page()
    open_page(browser, page)
    page.tell("setup", **SETUP)
    page.tell("state", name="anna", text="", over="", trouble=False)
    page.tell("costs", text="up 800 bit/s", delay_ms=None, begun_ms=None, fps=25)
    browser.wait("el('state').textContent.startsWith('connected, 0:0')")
    page.tell("state", name="anna", text="", over="", trouble=False, muted=True)
    browser.wait("el('state').textContent.endsWith('muted')")
    wait_for(lambda: len(page.pictures) > 3)
    page.close()
    browser.wait("ended && el('hang-up').hidden && el('mute').hidden && !el('costs').textContent")
    assert "To call again" in browser.value("el('words').textContent")
    assert browser.value("devices.stream") is None


def test_the_invitation_can_be_copied_and_fits_a_phone_on_its_side(
    browser: Browser, page: Page, tmp_path: Path
) -> None:
    size = {"width": 740, "height": 340, "deviceScaleFactor": 1, "mobile": True}
    browser.call("Emulation.setDeviceMetricsOverride", None, **size)
    try:
        open_page(browser, page)
        square = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"></svg>'
        page.tell("invitation", text="risorius://192.0.2.7:7447/anna#K7Q2", svg=square)
        text = "waiting for a call"
        page.tell("state", name="anna", text=text, over="Waiting for a call …", trouble=False)
        browser.wait("!el('invitation').hidden")
        inside = (
            "(() => { const card = el('over').getBoundingClientRect(),"
            " stage = el('stage').getBoundingClientRect();"
            " return card.top >= stage.top - 1 && card.bottom <= stage.bottom + 1; })()"
        )
        assert browser.value(inside)
        browser.value("navigator.clipboard.writeText = async text => { window.copied = text; }")
        browser.click("#invitation button")
        browser.wait("window.copied === 'risorius://192.0.2.7:7447/anna#K7Q2'")
    finally:
        browser.call("Emulation.clearDeviceMetricsOverride")


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_there_is_a_theme_for_either_preference(browser: Browser, page: Page, scheme: str) -> None:
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.call("Emulation.setEmulatedMedia", features=features)
    try:
        open_page(browser, page)
        colour = browser.value("getComputedStyle(document.body).backgroundColor")
        channels = [int(part) for part in colour[4:-1].split(",")]
        assert (min(channels) > 200) == (scheme == "light")
    finally:
        browser.call("Emulation.setEmulatedMedia", features=[])
