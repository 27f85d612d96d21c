"""Measures how late a live call is seen and heard: camera to screen, microphone to loudspeaker.

    python -m scripts.call_delay --seconds 60 [--low-delay]

Two ends on this host's loopback; a headless Chromium shows one of them.  The source is a clip whose
mouth opens at known times and sounds just then: a clock that a model of the face transmits.  Prints
a line of JSON:

    pictures_per_s   shown by the page
    delay_ms         median and 95th percentile from the moment a frame was taken to its picture
    drawn_ms         the same until the picture was drawn: the rest is the page's wait for its turn
    picture_ms       the delay by which the mouth on the page follows that of the source
    sound_ms         the same of the sound that the page plays
    sound_late_ms    the difference: more than 0, the sound is late
"""

import argparse
import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import aiohttp
import numpy as np
from numpy.typing import NDArray

from loopback.browser import Browser, find_browser
from loopback.process_pair import free_port
from scripts.call_delay.clip import FPS, is_open, write_clip
from scripts.command import run
from shared_model.errors import UserError

PROGRAM = (sys.executable, "-c", "from risorius.cli import main; exit(main())")
# How long the two ends may take until they see each other, and how long the face then settles.
START_S, SETTLE_S = 120.0, 12.0
STEP_S, MAX_DELAY_S = 0.005, 3.0
# Notes what the page shows and plays when: [ms since 1970, brightness of the mouth, frame,
# when it was drawn] and [ms since 1970, loudness].
NOTES = """
window.seen = []; window.heard = [];
const small = document.createElement("canvas"); small.width = small.height = 24;
const brush = small.getContext("2d", {willReadFrequently: true});
const player = players[OTHER], tick = player.tick.bind(player);
player.tick = () => {
  const before = player.shown;
  tick();
  if (player.shown === before) return;
  const {width, height} = player.canvas;
  brush.drawImage(player.canvas, width / 2 - height / 6, height * 0.55, height / 3, height * 0.3,
    0, 0, 24, 24);
  const data = brush.getImageData(0, 0, 24, 24).data;
  let sum = 0;
  for (let i = 0; i < data.length; i += 4) sum += data[i] + data[i + 1] + data[i + 2];
  const made = player.log[player.log.length - 1][2];
  seen.push([performance.timeOrigin + performance.now(), sum, player.index, made]);
};
const tap = new AudioWorkletNode(voice.context, "ear", {numberOfOutputs: 0, channelCount: 1,
  channelCountMode: "explicit"});
voice.node.connect(tap);
tap.port.onmessage = ({data}) => {
  const stamp = voice.context.getOutputTimestamp();
  const at = stamp.performanceTime + 1000 * (data.context - stamp.contextTime);
  let square = 0;
  for (const value of data.samples) square += value * value;
  heard.push([performance.timeOrigin + at, Math.sqrt(square / data.samples.length)]);
};
"""


def main(argv: Sequence[str]) -> None:
    """Print the figures of one call."""
    parser = argparse.ArgumentParser(
        prog="call_delay", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="to measure")
    parser.add_argument("--low-delay", action="store_true", help="packets of four pictures")
    options = parser.parse_args(argv)
    program = find_browser()
    if program is None:
        raise UserError("Chromium is not installed")
    with TemporaryDirectory() as name:
        print(json.dumps(measure(Path(name), program, options.seconds, options.low_delay)))


def measure(folder: Path, program: str, seconds: float, low_delay: bool) -> dict[str, object]:
    """The figures of a call of so many seconds."""
    clip = write_clip(folder)
    more = ["--low-delay"] if low_delay else []
    with ExitStack() as stack:
        where = f"127.0.0.1:{free_port()}"
        camera = ["--camera", str(clip), *more]
        sender = _end(stack, ["--listen", where, *camera])
        page = _end(stack, [where, *camera])
        flags = "--autoplay-policy=no-user-gesture-required"
        browser = stack.enter_context(Browser(program, folder / "browser", 900, 760, flags))
        browser.call("Page.navigate", url=page)
        browser.wait("typeof players != 'undefined' && players[OTHER].shown > 0", START_S)
        browser.wait("Boolean(voice.node)", START_S)
        time.sleep(SETTLE_S)
        browser.value(NOTES)
        time.sleep(seconds)
        seen, heard = np.array(browser.value("seen")), np.array(browser.value("heard"))
        return figures(seen, heard, asyncio.run(_begun_ms(sender)))


def figures(
    seen: NDArray[np.float64], heard: NDArray[np.float64], begun_ms: float
) -> dict[str, object]:
    """The figures from what a page has shown and played.

    seen: (n, 4) ms since 1970, brightness of the mouth, source frame, ms since 1970 when it was
    drawn.  heard: (n, 2) ms since 1970, loudness.  begun_ms: when the clip began.
    """
    taken_ms = begun_ms + 1000 / FPS * seen[:, 2]
    delay_ms, drawn_ms = seen[:, 0] - taken_ms, seen[:, 3] - taken_ms
    picture_ms = 1000 * lag_s((seen[:, 0] - begun_ms) / 1000, -seen[:, 1])
    sound_ms = 1000 * lag_s((heard[:, 0] - begun_ms) / 1000, heard[:, 1])
    span_s = (seen[-1, 0] - seen[0, 0]) / 1000
    return {
        "pictures_per_s": round((len(seen) - 1) / span_s, 1),
        "delay_ms": [round(float(np.percentile(delay_ms, each))) for each in (50, 95)],
        "drawn_ms": [round(float(np.percentile(drawn_ms, each))) for each in (50, 95)],
        "picture_ms": round(picture_ms),
        "sound_ms": round(sound_ms),
        "sound_late_ms": round(sound_ms - picture_ms),
    }


def lag_s(time_s: NDArray[np.float64], level: NDArray[np.float64]) -> float:
    """By how much a level (n,) noted at times (n,) follows the mouth of the clip."""
    lags_s = np.arange(0, MAX_DELAY_S, STEP_S)
    scores = [np.corrcoef(is_open(time_s - each), level)[0, 1] for each in lags_s]
    return float(lags_s[int(np.argmax(scores))])


async def _begun_ms(page: str) -> float:
    """When the camera of an end has begun, ms since 1970, as its page is told."""
    headers = {"Origin": page.rsplit("/", 2)[0]}
    async with (
        aiohttp.ClientSession() as client,
        client.ws_connect(f"{page}ws", headers=headers, max_msg_size=0) as socket,
    ):
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                told = json.loads(message.data)
                if told["kind"] == "costs" and told["begun_ms"]:
                    return float(told["begun_ms"])
    raise UserError("the other end has not begun")


def _end(stack: ExitStack, arguments: list[str]) -> str:
    """Start one end of a call, which is ended with the stack; returns the address of its page."""
    process = stack.enter_context(
        subprocess.Popen([*PROGRAM, "call", *arguments], stderr=subprocess.PIPE, text=True)
    )
    stack.callback(process.terminate)
    assert process.stderr is not None
    for line in process.stderr:
        if "page is at" in line:
            return line.split()[-1]
    raise UserError("an end of the call did not start")


if __name__ == "__main__":
    run(main)
