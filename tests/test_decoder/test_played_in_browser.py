"""Decoded videos are what browsers play."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from sounds import voiced_sound

from benchmarks.browser import Browser
from decoder.sinks.frame_sink import open_sink


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, chromium: str) -> Iterator[Browser]:
    folder = tmp_path_factory.mktemp("browser")
    flag = "--autoplay-policy=no-user-gesture-required"
    with Browser(chromium, folder, 400, 300, flag) as opened:
        yield opened


@pytest.mark.parametrize("size", [(64, 48), (63, 47)])
@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_chromium_plays_a_decoded_video_to_its_end(
    browser: Browser, tmp_path: Path, suffix: str, size: tuple[int, int]
) -> None:
    path, (width, height) = tmp_path / f"out{suffix}", size
    with open_sink(path, width, height, Fraction(25), "bt601", False, 8000) as sink:
        for number in range(10):
            sink.write(np.full((height, width, 3), 20 * number, np.uint8))
        sink.write_sound(voiced_sound(3200))
    browser.call("Page.navigate", url=path.as_uri())
    video = "document.querySelector('video')"
    browser.wait(f"{video} && {video}.readyState >= 2")
    assert browser.value(f"[{video}.videoWidth, {video}.videoHeight]") == [width, height]
    browser.value(f"void {video}.play()")
    browser.wait(f"{video}.ended")
    assert browser.value(f"{video}.error === null && {video}.duration > 0.3")
