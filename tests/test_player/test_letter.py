"""Letters in a browser: their pictures beside those of the decoder, their page, their errors."""

import base64
import os
import signal
import tempfile
import time
from itertools import cycle, islice
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from call_contents import count_packets
from conftest import without_layers
from sounds import voiced_sound
from vector_contents import VECTORS
from videos import read_frames

from benchmarks.browser import Browser
from benchmarks.played_letter import SOFTWARE_GL, PlayedLetter
from decoder.call_pictures import CallPictures
from decoder.playout.call_source import CallSource
from decoder.sinks.frame_sink import open_sink
from encoder.capture import video_source
from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source
from loopback.quality.psnr import squared_error
from protocol.summary import summarise
from risorius.cli import main
from risorius.command_line.parser import INTERRUPTED
from risorius.letter.letter_file import letter_page
from shared_model.arrays import Picture

Capture = pytest.CaptureFixture[str]
# Between the pictures of the two decoders; in pictures of 64x48 with textures of noise a pixel at
# the edge of the face weighs more, and what is added to the layers is larger than they are.
LEAST_PSNR_DB, LEAST_OF_VECTORS_DB = 45.0, 36.0
# Of player and data in a letter.
MOST_PLAYER_BYTES = 150_000


def letter_of(call: Path, folder: Path) -> Path:
    letter = folder / "letter.html"
    assert main(["letter", str(call), "-o", str(letter), "-q"]) == 0
    return letter


def decoded(call: Path) -> list[Picture]:
    with CallPictures(CallSource(call_file=call), lambda: False) as pictures:
        return [frame.picture for frame in pictures]


def check_pictures(call: Path, folder: Path, chromium: str, least_db: float) -> None:
    letter, expected = letter_of(call, folder), decoded(call)
    with PlayedLetter(chromium, folder / "profile", letter) as played:
        played.wait_until_decoded()
        assert played.frames == len(expected)
        for index in range(0, len(expected), max(1, len(expected) // 12)):
            error = float(np.mean(squared_error(expected[index], played.picture(index))))
            assert error < 255**2 / 10 ** (least_db / 10), f"frame {index}"
        assert (played.message, played.errors, played.requests) == ("", [], [])


@pytest.mark.parametrize("name", ["call", "live_call", "recorded_call"])
def test_the_page_draws_what_the_decoder_draws(
    name: str, request: pytest.FixtureRequest, tmp_path: Path, chromium: str
) -> None:
    check_pictures(request.getfixturevalue(name), tmp_path, chromium, LEAST_PSNR_DB)


@pytest.mark.parametrize("name", ["call_default", "call_layers", "call_residual"])
def test_the_page_draws_the_calls_of_the_vectors(name: str, tmp_path: Path, chromium: str) -> None:
    call = tmp_path / "call.rzo"
    call.write_bytes(bytes.fromhex((VECTORS / f"{name}.hex").read_text()))
    check_pictures(call, tmp_path, chromium, LEAST_OF_VECTORS_DB)


def test_a_letter_plays_seeks_and_loops(call: Path, tmp_path: Path, chromium: str) -> None:
    letter = letter_of(call, tmp_path)
    with PlayedLetter(chromium, tmp_path / "profile", letter, 390, 844) as played:
        played.wait_until_decoded()
        browser = played.browser
        browser.click("#play")
        browser.wait("letter.drawn > 5")
        browser.click("#play")
        assert not browser.value("letter.clock.isPlaying")
        browser.click("#place", 0.99)
        browser.wait("letter.drawn > 25")
        browser.click("#loop")
        browser.click("#play")
        browser.wait("letter.drawn < 5")
        browser.value("document.getElementById('screen').requestFullscreen = async () => isFull++")
        for key in "fF":
            browser.value("window.isFull = 0")
            browser.value(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")
            assert browser.value("isFull") == 1
        fits = "document.documentElement.scrollWidth <= innerWidth"
        assert browser.value(fits)
        assert not browser.value("navigator.onLine") and not played.requests


def test_a_letter_of_a_damaged_call_says_so(tmp_path: Path, chromium: str) -> None:
    letter = tmp_path / "letter.html"
    letter.write_text(letter_page(b"RZO2", "call", None))
    with PlayedLetter(chromium, tmp_path / "profile", letter) as played:
        played.browser.wait("document.getElementById('message').textContent.includes('cannot')")
        assert "no picture" in played.message


def test_a_browser_without_web_assembly_is_told(call: Path, tmp_path: Path, chromium: str) -> None:
    letter = letter_of(call, tmp_path)
    with Browser(chromium, tmp_path / "profile", 800, 600, *SOFTWARE_GL) as browser:
        browser.call("Page.enable")
        script = "delete window.WebAssembly"
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=script)
        browser.call("Page.navigate", url=letter.absolute().as_uri())
        browser.wait("document.getElementById('message')?.textContent.includes('no WebAssembly')")


def test_a_letter_is_small(call: Path, tmp_path: Path) -> None:
    size = letter_of(call, tmp_path).stat().st_size
    assert size - 5 * call.stat().st_size / 4 < MOST_PLAYER_BYTES


def test_decode_writes_a_letter_too(call: Path, tmp_path: Path) -> None:
    letter = tmp_path / "letter.html"
    assert main(["decode", str(call), "-o", str(letter), "-q"]) == 0
    assert letter.read_text() == letter_of(call, tmp_path).read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["letter", "missing.rzo", "-o", "a.html"], "no such file"),
        (["letter", "call.rzo", "-o", "a.mp4"], "a letter is a page; write a.html"),
        (
            ["letter", "call.rzo", "--bitrate", "500", "-o", "a.html"],
            "does not go with a call file",
        ),
        (["decode", "call.rzo", "--view", "-o", "a.html"], "--view does not go with a letter"),
        (["decode", "--listen", ":0", "--insecure", "-o", "a.html"], "record the call"),
    ],
)
def test_errors_are_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) != 0
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1


class StoppedCamera:
    """A camera that shows a video, and Ctrl-C once the call in `folder` has some packets.

    pictures: of the video, over and over again.
    """

    stated_fps = 5.0
    notes: ClassVar[list[str]] = []

    def __init__(self, pictures: list[Picture], folder: Path) -> None:
        self._pictures, self._folder = cycle(pictures), folder
        self._is_stopped = False

    def read(self) -> Picture:
        time.sleep(1 / self.stated_fps)
        parts = self._folder.glob("*/*.part")
        if not self._is_stopped and any(count_packets(part) >= 4 for part in parts):
            self._is_stopped = True
            os.kill(os.getpid(), signal.SIGINT)
        return next(self._pictures)

    def close(self) -> None:
        """Nothing is held."""


def test_a_letter_of_a_camera_ends_with_ctrl_c(
    slow_clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    pictures, letter = read_frames(slow_clip), tmp_path / "letter.html"
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    camera = StoppedCamera(pictures, tmp_path)
    monkeypatch.setattr(video_source, "CameraReader", lambda number: camera)
    with without_layers():
        assert main(["letter", "0", "-o", str(letter), "--model-bytes", "3000"]) == INTERRUPTED
    assert [path.name for path in tmp_path.iterdir()] == [letter.name]
    assert capsys.readouterr().out.startswith(f"{letter}: {letter.stat().st_size / 1e3:.1f} kB")
    call = tmp_path / "call.rzo"
    call.write_bytes(call_in(letter))
    summary = summarise(call)
    assert summary.complete and summary.profile == "default"
    assert summary.frame_packets > 1 and summary.damaged_packets == 0


def call_in(letter: Path) -> bytes:
    """The call file in a letter."""
    _, _, rest = letter.read_bytes().partition(b'id="call">')
    return base64.b85decode(rest.partition(b"<")[0].translate(bytes.maketrans(b"/,", b"<&")))


def test_a_letter_of_a_video_with_a_voice_is_heard(
    talking_clip: Path, tmp_path: Path, chromium: str
) -> None:
    clip, letter = tmp_path / "clip.mkv", tmp_path / "letter.html"
    with open_source(str(talking_clip)) as source:
        pictures = [picture for _, picture in islice(source, 25)]
    height, width = pictures[0].shape[:2]
    with open_sink(clip, width, height, exact_fps(25), sound_rate_hz=8000) as sink:
        for picture in pictures:
            sink.write(picture)
        sink.write_sound(voiced_sound(8000))
    options = ["--voice", "opus", "--model-bytes", "3000", "-q"]
    with without_layers():
        assert main(["letter", str(clip), "-o", str(letter), *options]) == 0
    flags = (*SOFTWARE_GL, "--autoplay-policy=no-user-gesture-required")
    with Browser(chromium, tmp_path / "profile", 800, 600, *flags) as browser:
        browser.call("Page.navigate", url=letter.absolute().as_uri())
        browser.wait("window.letter && letter.sound && letter.sound.readyState > 2")
        lengths = browser.value("[letter.sound.duration, letter.player.durationS]")
        assert abs(lengths[0] - lengths[1]) < 0.1
        browser.click("#play")
        browser.wait("letter.sound.currentTime > 0.2")
        assert abs(browser.value("letter.clock.timeS - letter.sound.currentTime")) < 0.05
