"""A whole call: one end with camera and microphone of a real browser, the other with a file."""

import os
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import cv2
import numpy as np
import pytest
from conftest import MakeOnce, Start
from processes import LIMIT_S, finish, first_line, wait_until
from shots import draw, talking
from sounds import voiced_sound, write_wave

from benchmarks.browser import Browser

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")
pytest.importorskip("pycodec2", reason="needs pycodec2: pip install '.[voice]'")
pytest.importorskip("webrtcvad", reason="needs webrtcvad: pip install '.[voice]'")

from call_watcher import Watcher

from benchmarks.played_letter import SOFTWARE_GL
from decoder.pipeline import DecodeOptions, decode
from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from loopback.process_pair import free_port
from protocol.errors import ProtocolError
from protocol.link.carriers import open_link_sink
from protocol.link.interface import LinkOptions, Reachability
from protocol.security.invitation import Invitation, parse_key, random_key
from protocol.security.link_security import LinkSecurity
from protocol.summary import summarise

# No test is of a rate: few pictures leave the processor to the other tests.
FPS, SECONDS = 5, 2.4


@dataclass(frozen=True, slots=True)
class Material:
    """What stands before the cameras: a file with sound; picture and sound for a browser.

    face: a picture of another face, which is blue.
    """

    clip: Path
    camera: Path
    microphone: Path
    face: Path


@pytest.fixture(scope="module")
def material(networks: Path, make_once: MakeOnce) -> Material:
    def make(folder: Path) -> None:
        draw(folder / "silent.mkv", talking(SECONDS, FPS))
        rate_hz = 16000
        sound = voiced_sound(round(SECONDS * rate_hz), rate_hz)
        write_wave(folder / "voice.wav", sound, rate_hz)
        with open_source(str(folder / "silent.mkv")) as capture:
            size = capture.width, capture.height
            frames = [frame for _, frame in capture]
        with open_sink(folder / "clip.mkv", *size, Fraction(FPS), "bt601", False, rate_hz) as sink:
            for frame in frames:
                sink.write(frame)
            sink.write_sound(sound)
        cv2.imwrite(str(folder / "face.png"), frames[0][..., ::-1])
        # Chromium's camera takes no other chroma.
        with (folder / "camera.y4m").open("wb") as file:
            file.write(b"YUV4MPEG2 W%d H%d F%d:1 Ip A1:1 C420jpeg\n" % (*size, FPS))
            for frame in frames:
                file.write(b"FRAME\n" + cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420).tobytes())

    folder = make_once("before_the_cameras", make)
    names = ("clip.mkv", "camera.y4m", "voice.wav", "face.png")
    return Material(*(folder / name for name in names))


@pytest.fixture
def browser(tmp_path: Path, material: Material, chromium: str) -> Iterator[Browser]:
    flags = (
        "--use-fake-ui-for-media-stream",
        "--use-fake-device-for-media-stream",
        f"--use-file-for-fake-video-capture={material.camera}",
        f"--use-file-for-fake-audio-capture={material.microphone}",
        "--autoplay-policy=no-user-gesture-required",
        *SOFTWARE_GL,
    )
    with Browser(chromium, tmp_path / "browser", 900, 760, *flags) as opened:
        yield opened


def page_of(process: "subprocess.Popen[str]") -> str:
    return said_until_page(process)[-1].split()[-1]


def said_until_page(process: "subprocess.Popen[str]") -> list[str]:
    """The lines up to that with the page's address."""
    assert process.stderr is not None
    lines = list[str]()
    while not lines or "the page is at http://127.0.0.1:" not in lines[-1]:
        lines.append(process.stderr.readline())
        assert lines[-1], lines
    return lines


def scanned(browser: Browser) -> str:
    """What the QR code on the page says."""
    left, top, width, height = map(int, browser.box("#invitation svg"))
    shown = browser.screenshot()[top : top + height, left : left + width]
    framed = cv2.copyMakeBorder(shown, 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=(255, 255, 255))
    # The other detector does not read every twentieth code.
    return str(cv2.QRCodeDetectorAruco().detectAndDecode(framed)[0])


def check_shared(address: str, invitation: Invitation) -> None:
    """It is the page that watches this end; the key is not sent."""
    place, _, key = address.partition("#")
    assert parse_key(key) == invitation.key
    assert place.startswith("http://127.0.0.1:") and place.endswith("/anna-a")
    with urlopen(place) as response:
        assert b"watch.js" in response.read()


def see_and_hear(browser: Browser, watcher: Watcher, second: "subprocess.Popen[str]") -> None:
    """Each end sees the other and oneself, and hears the other on the clock of the picture."""
    browser.wait("players[OTHER].shown > 10 && players[SELF].shown > 5")
    # This page draws by itself; the watcher is sent pictures.
    assert browser.value("[OTHER, SELF].every(who => players[who].drawer.scene !== null)")
    assert browser.value("el('name').textContent") == "anna"
    assert "bit/s" in browser.value("el('costs').textContent")
    wait_until(lambda: len(watcher.pictures) > 10, second)
    browser.wait("voice.heard && voice.heard.loud > 0.01")
    browser.wait("Math.abs(voice.heard.away) < 0.04")
    wait_until(lambda: watcher.loudness > 300, second)


def watch_in_another_tab(browser: Browser, watcher: Watcher, second: Any, page: str) -> None:
    """A second tab watches, and gives camera, microphone and sound once the first is closed."""
    with browser.tab(page) as first:
        browser.wait("typeof players != 'undefined' && players[OTHER].shown > 5")
        assert "Another tab" in browser.value("el('news').textContent")
        assert browser.value("first.is || !!devices.stream || !!voice.opening") is False
        browser.call("Page.navigate", first, url="about:blank")
        browser.wait("devices.stream && voice.heard && voice.heard.loud > 0.01")
        seen = len(watcher.pictures)
        wait_until(lambda: len(watcher.pictures) > seen + 10, second)
    browser.call("Page.navigate", url=f"{page}?draws")
    browser.wait("typeof players != 'undefined' && first.is && !!devices.stream")


def knock(invitation: Invitation, first: "subprocess.Popen[str]") -> list[str]:
    """A stranger is not heard, and that is said; who calls as well is told that there is a call.

    Returns what the first end has said until then.
    """
    place = LinkOptions(
        f"{invitation.call}-b", connect=(invitation.address,), connect_timeout_s=LIMIT_S
    )
    with open_link_sink(replace(place, security=LinkSecurity(random_key()))):
        said = [first_line(first)]
        while "knocks" not in said[-1]:
            assert said[-1], said
            said.append(first_line(first))
    with open_link_sink(replace(place, security=LinkSecurity(invitation.key))) as third:
        wait_until(lambda: third.reachability is Reachability.BUSY, first)
    return said


def show_another_face(browser: Browser, watcher: Watcher, second: Any) -> None:
    """The other end sees another face instead of the one before the camera."""

    def is_blue() -> bool:
        data = np.frombuffer(watcher.pictures[-1].jpeg, np.uint8)
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert picture is not None
        blue, _, red = picture.mean((0, 1))
        return bool(blue > red)

    assert not is_blue()
    browser.click("#face")
    wait_until(is_blue, second)


def switch_off(browser: Browser, watcher: Watcher, second: "subprocess.Popen[str]") -> None:
    """Whoever is muted and whose camera is off is still there."""
    for name in ("mute", "camera-off"):
        browser.click(f"#{name}")
        browser.wait(f"el('{name}').getAttribute('aria-pressed') == 'true'")
    wait_until(lambda: watcher.said("state", "text", "camera off"), second)
    seen = len(watcher.pictures)
    wait_until(lambda: len(watcher.pictures) > seen + 10, second)


def holds_packets(recording: Path) -> bool:
    """Whether a recording, which may still be written, has more than two packets of faces."""
    try:
        return summarise(recording).frame_packets > 2
    except ProtocolError:  # it has no model yet
        return False


def record_and_reload(browser: Browser, watcher: Watcher, second: Any, folder: Path) -> None:
    """Both sides are recorded, and the page comes back in the middle of it."""

    def all_hold_packets() -> bool:
        return all(map(holds_packets, folder.glob("anna-*")))

    browser.click("#record")
    browser.wait("el('record').getAttribute('aria-pressed') == 'true'")
    wait_until(lambda: len(list(folder.glob("anna-*"))) == 2, second)
    wait_until(all_hold_packets, second)
    browser.call("Page.reload")
    browser.wait("typeof players != 'undefined' && players[OTHER].shown > 10")
    assert browser.value("el('mute').getAttribute('aria-pressed')") == "true"
    browser.click("#record")
    wait_until(lambda: len(list(folder.glob("anna-*.rzo"))) == 2, second)
    for recording in folder.glob("anna-*.rzo"):
        summary = summarise(recording)
        assert summary.complete and summary.frame_packets > 2 and summary.damaged_packets == 0
        assert summary.voice == "1200"
        report = decode(DecodeOptions(recording), lambda done, total: None, lambda: False)
        assert report.complete and report.frames == summary.frames > 10


def kill_with_parts(process: "subprocess.Popen[str]") -> None:
    """As if its host went down: no part of it says goodbye."""
    process.send_signal(signal.SIGSTOP)
    for part in descendants(process.pid):
        os.kill(part, signal.SIGKILL)
    process.kill()


def descendants(pid: int) -> list[int]:
    """The children of a process, and theirs; a child comes before its own."""
    children = map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())
    return [each for child in children for each in (child, *descendants(child))]


def come_back_and_be_killed(browser: Browser, second: "subprocess.Popen[str]") -> None:
    """Whoever has left may call again; whoever is killed is waited for."""
    page_of(second)
    browser.wait("el('state').textContent.startsWith('connected, ')")
    kill_with_parts(second)
    browser.wait("el('state').textContent == 'link lost, trying'")


def test_two_people_see_and_hear_each_other(
    material: Material, browser: Browser, start: Start, tmp_path: Path
) -> None:
    """Until one leaves and the other hangs up."""
    invitation = Invitation("127.0.0.1", free_port(), "anna", random_key())
    line, folder = tmp_path / "invitation", ("--folder", tmp_path)
    line.write_text(str(invitation))
    place = ("--listen", invitation.address, "--invite-file", line, "--share", "0")
    first = start("call", *place, *folder, "--face", material.face)
    *_, shared, page = (each.split()[-1] for each in said_until_page(first))
    browser.call("Page.navigate", url=f"{page}?draws")
    browser.wait("typeof players != 'undefined'")
    browser.wait("el('state').textContent == 'waiting for a call'")
    assert browser.value("el('invitation').querySelector('code').textContent") == str(invitation)
    assert scanned(browser) == shared
    check_shared(shared, invitation)
    second = start("call", str(invitation), *folder, "--camera", material.clip)
    with Watcher(page_of(second)) as watcher:
        see_and_hear(browser, watcher, second)
        watch_in_another_tab(browser, watcher, second, page)
        said = knock(invitation, first)
        show_another_face(browser, watcher, second)
        switch_off(browser, watcher, second)
        record_and_reload(browser, watcher, second, tmp_path)
        second.send_signal(signal.SIGINT)
        assert finish(second)[0] == 0
        browser.wait("el('state').textContent == 'has left'")
    camera = ("--camera", material.clip, "--voice", "off")
    come_back_and_be_killed(browser, start("call", str(invitation), *camera))
    browser.click("#hang-up")
    code, told = finish(first)
    lines = said + told.splitlines()
    assert code == 0 and lines[-2:] == ["call: anna: is here", "call: anna: link lost, trying"]
    # "is calling" may be over before it is said.
    assert lines.index("call: anna: is here") < lines.index("call: anna: has left")
    browser.wait("ended")


def test_nobody_at_the_address_is_a_failed_link(material: Material, start: Start) -> None:
    where = f"127.0.0.1:{free_port()}"
    caller = start("call", where, "--camera", material.clip, "--timeout", "0.5")
    page_of(caller)
    code, stderr = finish(caller)
    assert code == 4 and f"cannot reach {where}" in stderr
