"""Measures how late a live call is seen and heard: camera to screen, microphone to loudspeaker.

    python -m scripts.call_delay --seconds 60 [--low-delay]
    python -m scripts.call_delay --clips seen.mp4 other.mp4

Two ends on this host's loopback; a headless Chromium shows one of them.  The source is a clip whose
mouth opens at known times and sounds just then: a clock that a model of the face transmits.  With
--clips the ends have these two for cameras, and the page shows the first; nothing is known of their
mouths.  Prints a line of JSON:

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
from scripts.call_delay.clip import is_open, write_clip
from scripts.command import run
from shared_model.errors import UserError

PROGRAM = (sys.executable, "-c", "from risorius.cli import main; exit(main())")
# How long the two ends may take until they see each other, and how long the face then settles.
START_S, SETTLE_S = 180.0, 12.0
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
if (voice.node) {
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
}
"""


def main(argv: Sequence[str]) -> None:
    """Print the figures of one call."""
    parser = argparse.ArgumentParser(
        prog="call_delay", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="to measure")
    parser.add_argument("--clips", nargs=2, type=Path, metavar=("SEEN", "OTHER"))
    parser.add_argument("--low-delay", action="store_true", help="packets of four pictures")
    options = parser.parse_args(argv)
    program = find_browser()
    if program is None:
        raise UserError("Chromium is not installed")
    with TemporaryDirectory() as name:
        folder, more = Path(name), ["--low-delay"] if options.low_delay else []
        cameras = options.clips or [write_clip(folder)] * 2
        notes = measure(folder, program, cameras, more, options.seconds)
        print(json.dumps(figures(*notes, knows_mouth=not options.clips)))


def measure(
    folder: Path, program: str, cameras: Sequence[Path], more: Sequence[str], seconds: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """What the page notes in a call of so many seconds, see `figures`.

    cameras: of the end that is seen, and of the one whose page is looked at.  more: options.
    """
    with ExitStack() as stack:
        where = f"127.0.0.1:{free_port()}"
        sender = _end(stack, ["--listen", where, "--camera", str(cameras[0]), *more])
        page = _end(stack, [where, "--camera", str(cameras[1]), *more])
        flags = "--autoplay-policy=no-user-gesture-required"
        browser = stack.enter_context(Browser(program, folder / "browser", 900, 760, flags))
        browser.call("Page.navigate", url=page)
        browser.wait("typeof players != 'undefined' && players[OTHER].shown > 0", START_S)
        time.sleep(SETTLE_S)
        browser.value(NOTES)
        time.sleep(seconds)
        begun_ms, fps = asyncio.run(_begun(sender))
        seen, heard = np.array(browser.value("seen")), np.array(browser.value("heard"))
        seen[:, 2] = begun_ms + 1000 / fps * seen[:, 2]
        return seen, heard, begun_ms


def figures(
    seen: NDArray[np.float64], heard: NDArray[np.float64], begun_ms: float, knows_mouth: bool = True
) -> dict[str, object]:
    """The figures from what a page has shown and played.

    seen: (n, 4) ms since 1970, brightness of the mouth, and when it was taken and drawn.  heard:
    (n, 2) ms since 1970, loudness.  begun_ms: when the clip began.
    """
    delay_ms, drawn_ms = seen[:, 0] - seen[:, 2], seen[:, 3] - seen[:, 2]
    span_s = (seen[-1, 0] - seen[0, 0]) / 1000
    found: dict[str, object] = {
        "pictures_per_s": round((len(seen) - 1) / span_s, 1),
        "delay_ms": [round(float(np.percentile(delay_ms, each))) for each in (50, 95)],
        "drawn_ms": [round(float(np.percentile(drawn_ms, each))) for each in (50, 95)],
    }
    if not knows_mouth:
        return found
    picture_ms = 1000 * lag_s((seen[:, 0] - begun_ms) / 1000, -seen[:, 1])
    sound_ms = 1000 * lag_s((heard[:, 0] - begun_ms) / 1000, heard[:, 1])
    late_ms = sound_ms - picture_ms
    names = ("picture_ms", "sound_ms", "sound_late_ms")
    return found | dict(zip(names, map(round, (picture_ms, sound_ms, late_ms)), strict=True))


def lag_s(time_s: NDArray[np.float64], level: NDArray[np.float64]) -> float:
    """By how much a level (n,) noted at times (n,) follows the mouth of the clip."""
    lags_s = np.arange(0, MAX_DELAY_S, STEP_S)
    scores = [np.corrcoef(is_open(time_s - each), level)[0, 1] for each in lags_s]
    return float(lags_s[int(np.argmax(scores))])


async def _begun(page: str) -> tuple[float, float]:
    """When the camera of an end has begun, ms since 1970, and its rate, as its page is told."""
    headers = {"Origin": page.rsplit("/", 2)[0]}
    async with (
        aiohttp.ClientSession() as client,
        client.ws_connect(f"{page}ws", headers=headers, max_msg_size=0) as socket,
    ):
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                told = json.loads(message.data)
                if told["kind"] == "costs" and told["begun_ms"]:
                    return float(told["begun_ms"]), float(told["fps"])
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
