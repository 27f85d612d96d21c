"""Ten minutes of a call whose sound cards have clocks of their own, in the page's own code."""

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from benchmarks.browser import Browser
from benchmarks.call_delay.clocks import WORKLET_CODE, figures, voice_late
from risorius.call_page.page_thread import PageThread

# The greatest error of tones of 1 and 3 kHz from 8 to 44.1 kHz.
TONES = """[1000, 3000].map(pitch => {
  const kinds = {}, rate = 8000, cardRate = 44100;
  class Processor { constructor() { this.port = {postMessage() {}}; } }
  new Function("AudioWorkletProcessor", "registerProcessor", "sampleRate", WORKLET_CODE)(
    Processor, (name, kind) => { kinds[name] = kind; }, cardRate);
  const voice = new kinds.voice({processorOptions: {rate}}), output = new Float32Array(128);
  const tone = time => Math.sin(2 * Math.PI * pitch * time);
  const samples = Float32Array.from({length: rate}, (_, i) => tone(i / rate));
  voice.port.onmessage({data: {time: 0, samples}});
  voice.port.onmessage({data: {anchor: {context: 0, source: 0}}});
  let worst = 0;
  for (let block = 0; block < 300; block++) {
    globalThis.currentTime = block * 128 / cardRate;
    voice.process([], [[output]]);
    for (let i = 0; block && i < 128; i++)
      worst = Math.max(worst, Math.abs(output[i] - tone((block * 128 + i) / cardRate)));
  }
  return worst;
})"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, chromium: str) -> Iterator[Browser]:
    folder = tmp_path_factory.mktemp("browser")
    with PageThread(0) as page, Browser(chromium, folder, 400, 300) as opened:
        opened.call("Page.navigate", url=page.address)
        opened.wait("typeof players != 'undefined'")
        opened.value(WORKLET_CODE)
        yield opened


@pytest.mark.parametrize("ppm", [-200.0, 200.0])
def test_voice_and_picture_stay_together_whatever_the_sound_cards_do(
    ppm: float, browser: Browser
) -> None:
    late = voice_late(browser, 600, ppm, -ppm)
    assert len(late) > 550 and late[-1, 0] > 590
    assert np.abs(late[:, 1]).max() < 0.04
    begin_ms, end_ms = figures(late)["voice_late_ms"][:2]
    assert abs(begin_ms) <= 5 and abs(end_ms - begin_ms) <= 5


def test_the_voice_keeps_its_sound_at_the_rate_of_the_sound_card(browser: Browser) -> None:
    low, high = browser.value(TONES)
    assert low < 0.02 and high < 0.05
