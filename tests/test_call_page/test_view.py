"""A one-way call in a real browser while it is decoded, and as raw video while it comes."""

import signal
import subprocess
from collections.abc import Iterator
from fractions import Fraction
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from conftest import PROGRAM, ROOT, Start
from processes import finish, one_line
from sounds import voiced_sound
from videos import endless_video

from benchmarks.browser import Browser
from benchmarks.played_letter import SOFTWARE_GL
from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from protocol.call_file import MAGIC, CallReader
from protocol.call_records import RecordWriter
from risorius.cli import main

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, chromium: str) -> Iterator[Browser]:
    flags = "--autoplay-policy=no-user-gesture-required"
    with Browser(chromium, tmp_path_factory.mktemp("browser"), 800, 640, flags) as opened:
        yield opened


def address_of(process: "subprocess.Popen[str]") -> str:
    assert process.stderr is not None
    line = process.stderr.readline()
    assert "shown at http://127.0.0.1:" in line, line + process.stderr.read()
    return line.split()[-1]


def test_every_picture_of_a_call_is_shown_at_its_time(
    call: Path, tmp_path: Path, start: Start, browser: Browser
) -> None:
    viewer = start("decode", call, "--view", "-q", "-o", tmp_path / "%04d.png")
    browser.call("Page.navigate", url=address_of(viewer))
    code, stderr = finish(viewer)
    assert (code, stderr) == (0, "")
    browser.wait("ended")
    assert browser.value("el('name').textContent") == "call.rzo"
    # Its last picture stays in sight: it can be played again.
    assert "has ended" in browser.value("el('state').textContent")
    assert browser.value("el('over').hidden && !el('tape').hidden")
    written = sorted(tmp_path.glob("*.png"))
    browser.wait(f"players[OTHER].index == {len(written) - 1}")
    data = browser.value("el('other').toDataURL('image/png')")
    shown = picture_of(data)
    last = cv2.imread(str(written[-1]))
    assert last is not None and cv2.PSNR(shown, last) > 30


def test_a_page_that_can_draws_the_faces(
    call: Path, tmp_path: Path, start: Start, chromium: str
) -> None:
    viewer = start("decode", call, "--view", "-q", "-o", tmp_path / "%04d.png")
    with Browser(chromium, tmp_path / "b", 800, 640, *SOFTWARE_GL) as browser:
        browser.call("Page.navigate", url=f"{address_of(viewer)}?draws")
        code, stderr = finish(viewer)
        assert (code, stderr) == (0, "")
        written = sorted(tmp_path.glob("*.png"))
        # The last face waits until its model has been decoded.
        browser.wait(f"ended && players[OTHER].index == {len(written) - 1}")
        browser.wait("players[OTHER].drawer?.scene")
        for place in (len(written) - 1, len(written) // 2):
            browser.value(f"tape.touch(tape.pictures.find(p => p.index == {place}).time, false)")
            browser.wait(f"tape.isTouched && players[OTHER].index == {place}")
            shown = picture_of(browser.value("el('other').toDataURL('image/png')"))
            drawn = cv2.imread(str(written[place]))
            assert drawn is not None and cv2.PSNR(shown, drawn) > 40


def picture_of(data_url: str) -> Any:
    """The picture in a data URL, (height, width, 3) uint8 BGR."""
    from base64 import b64decode

    data = np.frombuffer(b64decode(data_url.partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)


FOREIGN = """<!doctype html><title>elsewhere</title><iframe id=frame src="{page}"></iframe>
<img id=img src="{page}stream.mjpg"><script>
window.found = {{}};
const note = (name, what) => found[name] = what;
fetch("{page}").then(r => note("fetch", r.status), e => note("fetch", "refused"));
img.onload = () => note("img", "seen"); img.onerror = () => note("img", "refused");
const s = new WebSocket("{socket}");
s.onopen = () => {{ note("ws", "open"); s.send('{{"kind": "hang-up"}}'); }};
s.onerror = () => note("ws", "refused");
</script>"""


class Elsewhere(ThreadingHTTPServer):
    """Another page of this host, that has got to know the secret address."""

    def __init__(self, page: str) -> None:
        socket = f"ws{page.removeprefix('http')}ws"
        self.body = FOREIGN.format(page=page, socket=socket).encode()
        super().__init__(("127.0.0.1", 0), ElsewhereHandler)


class ElsewhereHandler(BaseHTTPRequestHandler):
    server: Elsewhere

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(self.server.body)

    def log_message(self, format: str, *arguments: Any) -> None:
        pass


def test_another_page_in_the_same_browser_can_neither_watch_nor_steer(
    call: Path, start: Start, browser: Browser
) -> None:
    viewer = start("decode", call, "--view", "-q")
    address = address_of(viewer)
    with Elsewhere(address) as elsewhere:
        Thread(target=elsewhere.serve_forever, daemon=True).start()
        for name in ("127.0.0.1", "localhost"):
            browser.call("Page.navigate", url=f"http://{name}:{elsewhere.server_port}/")
            browser.wait("typeof found == 'object' && Object.keys(found).length == 3")
            found = browser.value("found")
            assert found == {"fetch": "refused", "img": "refused", "ws": "refused"}
            # A frame is blank at first; one that may not be shown gets a page of the browser's, of
            # another origin.
            browser.wait("frame.contentDocument === null")
        elsewhere.shutdown()
    # It has not begun: nobody was let in.
    assert viewer.poll() is None
    port = urlsplit(address).port
    browser.call("Page.navigate", url=f"http://127.0.0.1:{port}/")
    browser.wait("document.body && document.body.innerText.includes('no such page')")


def test_the_voice_of_a_call_is_played_with_its_pictures(
    carphone: Path, tmp_path: Path, start: Start, browser: Browser
) -> None:
    pytest.importorskip("pycodec2")
    pytest.importorskip("webrtcvad")
    talking, call = tmp_path / "talking.mkv", tmp_path / "call.rzo"
    with open_source(str(carphone)) as capture:
        size = capture.width, capture.height
        frames = [frame for _, frame in zip(range(40), capture, strict=False)]
    # Slow, so that a busy browser has opened its sound long before the end.
    with open_sink(talking, *size, Fraction(10), "bt601", False, 8000) as sink:
        for _, frame in frames:
            sink.write(frame)
        sink.write_sound(voiced_sound(800 * len(frames)))
    assert main(["encode", str(talking), "-o", str(call), "--profile", "thesis", "-q"]) == 0
    viewer = start("decode", call, "--view", "-q")
    browser.call("Page.navigate", url=address_of(viewer))
    browser.wait("typeof voice != 'undefined' && voice.heard && voice.heard.loud > 0.01")
    viewer.send_signal(signal.SIGINT)
    code, stderr = finish(viewer)
    assert code == 130 and "stopped before the end of the call" in one_line(stderr)


def test_what_an_encoder_sends_is_shown_to_the_sender(
    carphone: Path, tmp_path: Path, start: Start, browser: Browser
) -> None:
    options = ("--profile", "thesis", "--pace", "-q")
    with endless_video(carphone, tmp_path / "endless.y4m") as video:
        encoder = start("encode", video.path, "-o", tmp_path / "call.rzo", "--view", *options)
        browser.call("Page.navigate", url=address_of(encoder))
        browser.wait("typeof players != 'undefined' && players[OTHER].index >= 19")
        assert browser.value("el('name').textContent") == "What is sent"
    assert finish(encoder) == (0, "")
    browser.wait(f"players[OTHER].index == {video.count - 1}")


def test_raw_video_is_written_as_its_pictures_come(call: Path) -> None:
    with CallReader(call) as reader:
        packets = list(reader)
    command = [*PROGRAM, "decode", "-", "-o", "-", "-q"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT
    ) as decoder:
        assert decoder.stdin is not None and decoder.stdout is not None
        records = RecordWriter()
        decoder.stdin.write(MAGIC)
        for packet in packets[:-1]:
            decoder.stdin.write(records.record(packet))
        decoder.stdin.flush()
        # The call has not ended, and yet its pictures are there.
        head = decoder.stdout.readline()
        assert head.startswith(b"YUV4MPEG2 W176 H144 ")
        assert decoder.stdout.readline() == b"FRAME\n"
        assert len(decoder.stdout.read(3 * 176 * 144)) == 3 * 176 * 144
        decoder.stdin.write(records.record(packets[-1]))
        decoder.stdin.close()
        decoder.stdout.read()
        assert decoder.wait() == 0


def test_a_recorded_call_can_be_stopped_gone_through_and_played_again(
    call: Path, start: Start, browser: Browser
) -> None:
    viewer = start("decode", call, "--view", "-q")
    browser.call("Page.navigate", url=address_of(viewer))
    browser.wait("typeof tape != 'undefined' && tape.is && players[OTHER].shown > 3")
    browser.click("#play")
    browser.wait("!tape.isPlaying && el('play').getAttribute('aria-label') == 'Play'")
    stopped = browser.value("tape.place")
    assert finish(viewer)[0] == 0
    browser.wait("ended")
    # The program has ended; the page has the whole call, and stands where it was stopped.
    end = browser.value("tape.end")
    assert 0 < stopped < end and browser.value("tape.place") == stopped
    browser.value(f"el('place').value = {end / 2}; el('place').oninput()")
    shown = f"Math.abs(tape.pictures[tape.shown].time - {end / 2}) < 0.1"
    browser.wait(f"tape.shown >= 0 && {shown}")
    browser.click("#play")
    browser.wait("!tape.isPlaying && el('play').getAttribute('aria-label') == 'Play again'")
    browser.wait("players[OTHER].index == tape.pictures.at(-1).index")
    browser.click("#play")
    browser.wait("tape.isPlaying && tape.place < tape.end / 2")
    browser.wait("!tape.isPlaying")
