"""Simulates how far the sound of a long call gets away from its pictures: sound cards have clocks
of their own.

    python -m benchmarks call_delay.clocks [--minutes 10] [--ppm 200]

The page's code runs in a headless Chromium with a simulated clock: ten minutes take seconds.  One
sound card is the microphone's: its pieces get their times from the page, and are put on the clock
of the pictures as an encoder does it.  The other one plays what the worklet of the page gives it.
Each runs by --ppm millionths too fast or too slow.  The sound is a click every second.  Between the
two the sound comes in packets, with the pictures, each with a delay of its own; codecs and the link
are left out.  Prints a line of JSON for each pair of cards:

    microphone_ppm, loudspeaker_ppm    how much faster they run
    voice_late_ms    by how much a click is heard after its picture is shown: median of the first
        and of the last minute, and the least and the most of all
"""

import argparse
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.browser import Browser, find_browser
from benchmarks.command import run
from encoder.sound.drift_compensator import DriftCompensator
from risorius.call_page.page_thread import PageThread
from shared_model.arrays import Array
from shared_model.errors import UserError

RATE_HZ, PIECE_S, PACKET_S, FPS = 8000, 0.02, 0.32, 25
CARD_HZ = 16000  # of the loudspeaker's
# A click has the shape of a triangle, so long on either side of its peak, with this height.
EDGE_S, HEIGHT = 0.004, 16000.0
# Until the offset of the pictures has been found, and the sound is where it belongs.
SETTLE_S = 10.0
# Latency of either card, and the mean by which pieces and packets come later than at the best.
LATENCY_S, PIECE_LATE_S, PACKET_LATE_S = 0.02, 0.003, 0.03

# What surrounds the functions: the clock of the page while it is simulated, seconds; `random` is
# the same each time.
CLOCK = """
let time = 1000, seed = 1;
const random = () => (seed = (48271 * seed) % 2147483647) / 2147483647;
const late = mean => -mean * Math.log(1 - random());
const realNow = performance.now;
performance.now = () => 1000 * time;
"""
# Times at which pieces of the microphone began, by the page; seconds since the call began.
MICROPHONE = """({seconds, rate, pieceS, card, latencyS, lateS}) => {
  const clock = new CardClock(latencyS), begun = time, begins = [];
  let last = 0;
  for (let end = pieceS; end / card < seconds; end += pieceS) {
    last = time = Math.max(last, begun + end / card + latencyS + late(lateS));
    begins.push((clock.heard(end) - performance.timeOrigin) / 1000 - pieceS - begun);
  }
  performance.now = realNow;
  return begins;
}"""
# Defines the code of the page's worklet, as text.
WORKLET_CODE = "const WORKLET_CODE = " + json.dumps(
    (files("risorius.call_page") / "voice_worklet.js").read_text("utf-8")
)
# [time in the source, by how much it was heard after its picture was shown] of each click, seconds.
LOUDSPEAKER = """async options => {
  const {seconds, rate, cardRate, card, latencyS, lateS, packetS, fps, edgeS, clicks} = options;
  const kinds = {}, player = players[OTHER], begun = time, block = 128, found = [];
  class Processor { constructor() { this.port = {postMessage() {}}; } }
  new Function("AudioWorkletProcessor", "registerProcessor", "sampleRate", WORKLET_CODE)(
    Processor, (name, kind) => { kinds[name] = kind; }, cardRate);
  const worklet = new kinds.voice({processorOptions: {rate}}), output = new Float32Array(block);
  let blocks = 0;
  const context = {
    outputLatency: latencyS,
    get currentTime() { return blocks * block / cardRate; },
    getOutputTimestamp: () =>
      ({contextTime: (time - begun - latencyS) * card, performanceTime: 1000 * time}),
  };
  player.reset();
  Object.assign(voice, {context, rate, opening: Promise.resolve(),
    node: {port: {postMessage: data => worklet.port.onmessage({data})}}});
  const sound = first => {
    const samples = new Float32Array(Math.round(packetS * rate));
    for (const click of clicks) {
      if (click < first - 1 || click > first + packetS + 1) continue;
      for (let i = 0; i < samples.length; i++)
        samples[i] += Math.max(0, 1 - Math.abs(first + i / rate - click) / edgeS);
    }
    return samples;
  };
  let sum = 0, moment = 0, align = 0;
  const play = () => {
    globalThis.currentTime = context.currentTime;
    worklet.process([], [[output]]);
    for (let i = 0; i < block; i++) {
      const at = begun + (blocks * block + i) / cardRate / card + latencyS;
      if (Math.abs(output[i]) > 0.02) { sum += output[i]; moment += output[i] * at; continue; }
      if (sum > edgeS * cardRate / 2) {
        const heard = moment / sum, source = heard - player.offset;
        const click = clicks.reduce((a, b) => Math.abs(b - source) < Math.abs(a - source) ? b : a);
        found.push([click, source - click]);
      }
      sum = moment = 0;
    }
    blocks++;
  };
  let arrival = 0;
  for (let first = 0; first + packetS < seconds; first += packetS) {
    arrival = Math.max(arrival, begun + first + packetS + late(lateS));
    for (;;) {
      const next = begun + blocks * block / cardRate / card;
      if (Math.min(next, align || begun) > arrival) break;
      if (next < (align || begun)) { time = next; play(); }
      else { time = align || begun; align = time + 0.1; voice.align(); }
    }
    time = arrival;
    await voice.play(rate, first, sound(first));
    for (let i = 0; i < packetS * fps; i++) player.arrived(first + i / fps, MARGIN_S - i / fps);
  }
  performance.now = realNow;
  return found;
}"""


def main(argv: Sequence[str]) -> None:
    """Print the figures of every pair of cards."""
    parser = argparse.ArgumentParser(
        prog="call_delay.clocks",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=10.0, help="of the call")
    parser.add_argument("--ppm", type=float, default=200.0, help="by which cards run too fast")
    options = parser.parse_args(argv)
    program = find_browser()
    if program is None:
        raise UserError("Chromium is not installed")
    with (
        TemporaryDirectory() as folder,
        PageThread(0) as page,
        Browser(program, Path(folder), 400, 300) as browser,
    ):
        browser.call("Page.navigate", url=page.address)
        browser.wait("typeof players != 'undefined'")
        browser.value(WORKLET_CODE)
        for microphone in (-options.ppm, options.ppm):
            for loudspeaker in (-options.ppm, options.ppm):
                late = voice_late(browser, 60 * options.minutes, microphone, loudspeaker)
                cards = {"microphone_ppm": microphone, "loudspeaker_ppm": loudspeaker}
                print(json.dumps(cards | figures(late)))


def figures(late: Array) -> dict[str, list[int]]:
    """The figures of a call.  late: (n, 2) time of each click, and by how much it is late, s."""
    first = late[late[:, 0] < late[0, 0] + 60, 1]
    last = late[late[:, 0] > late[-1, 0] - 60, 1]
    values = (np.median(first), np.median(last), late[:, 1].min(), late[:, 1].max())
    return {"voice_late_ms": [round(1000 * float(value)) for value in values]}


def voice_late(browser: Browser, seconds: float, microphone: float, loudspeaker: float) -> Array:
    """Times of clicks in a call, and by how much they are heard after their pictures (n, 2), s.

    browser: shows a page of a call.  microphone, loudspeaker: by how many millionths they run fast.
    """
    begins = _called(
        browser,
        MICROPHONE,
        seconds=seconds,
        pieceS=PIECE_S,
        card=1 + microphone / 1e6,
        latencyS=LATENCY_S,
        lateS=PIECE_LATE_S,
    )
    truth = np.arange(1.0, seconds - 1, 1.0)
    sent = clicks_in_call(np.array(begins), truth, 1 + microphone / 1e6)
    found = _called(
        browser,
        LOUDSPEAKER,
        seconds=seconds,
        rate=RATE_HZ,
        cardRate=CARD_HZ,
        card=1 + loudspeaker / 1e6,
        latencyS=LATENCY_S,
        lateS=PACKET_LATE_S,
        packetS=PACKET_S,
        fps=FPS,
        edgeS=EDGE_S,
        clicks=[round(float(click), 6) for click in sent],
    )
    heard = np.array(found)
    heard = heard[heard[:, 0] > SETTLE_S]
    which = np.abs(sent[:, None] - heard[None, :, 0]).argmin(axis=0)
    return np.stack([truth[which], heard[:, 1] + heard[:, 0] - truth[which]], axis=1)


def clicks_in_call(begins: Array, clicks: Array, card: float) -> Array:
    """Where the clicks (k,) of a microphone are in the sound of the call, seconds.

    begins: (n,) when its pieces began, as the page says.  card: its seconds in one of the call.
    """
    compensator, size = DriftCompensator(RATE_HZ), round(PIECE_S * RATE_HZ)
    pieces = [np.zeros(0, np.int16)]
    for number, begin_s in enumerate(begins):
        time_s = (number * size + np.arange(size)) / RATE_HZ / card
        near = clicks[np.abs(clicks - time_s[size // 2]).argmin()]
        level = HEIGHT * np.maximum(0, 1 - np.abs(time_s - near) / EDGE_S)
        pieces.append(compensator.put(np.asarray(level, np.int16), begin_s * RATE_HZ))
    sound = np.concatenate(pieces).astype(float)
    loud = np.flatnonzero(sound > 0.02 * HEIGHT)
    groups = np.split(loud, np.flatnonzero(np.diff(loud) > RATE_HZ * EDGE_S) + 1)
    return np.array([np.average(group, weights=sound[group]) / RATE_HZ for group in groups])


def _called(browser: Browser, function: str, **arguments: object) -> list[object]:
    """What a JavaScript function on the page returns."""
    answer = browser.call(
        "Runtime.evaluate",
        expression=f"(() => {{ {CLOCK} return ({function})({json.dumps(arguments)}); }})()",
        returnByValue=True,
        awaitPromise=True,
    )
    if "exceptionDetails" in answer:
        raise RuntimeError(answer["exceptionDetails"])
    values: list[object] = answer["result"]["value"]
    return values


if __name__ == "__main__":
    run(main)
