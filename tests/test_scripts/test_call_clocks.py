"""Ten minutes of a call whose sound cards have clocks of their own, in the page's own code."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from loopback.browser import Browser, find_browser
from risorius.call_page.page_thread import PageThread
from scripts.call_delay.clocks import figures, voice_late


@pytest.mark.parametrize("ppm", [-200.0, 200.0])
def test_voice_and_picture_stay_together_whatever_the_sound_cards_do(
    ppm: float, tmp_path: Path
) -> None:
    program = find_browser()
    if program is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with PageThread(0) as page, Browser(program, tmp_path / "browser", 400, 300) as browser:
        browser.call("Page.navigate", url=page.address)
        browser.wait("typeof players != 'undefined'")
        late = voice_late(browser, 600, ppm, -ppm)
    assert len(late) > 550 and late[-1, 0] > 590
    assert np.abs(late[:, 1]).max() < 0.04
    begin_ms, end_ms = figures(late)["voice_late_ms"][:2]
    assert abs(begin_ms) <= 5 and abs(end_ms - begin_ms) <= 5
