"""Measures how late a live call is seen and heard: camera to screen, microphone to loudspeaker.

    python -m benchmarks call_delay --seconds 60 [--low-delay]
    python -m benchmarks call_delay --clips seen.mp4 other.mp4
    python -m benchmarks call_delay --one-way
    python -m benchmarks call_delay --minutes 10
    python -m benchmarks call_delay --both-pages [--draws] [--busy 3]
    python -m benchmarks call_delay --clips seen.mp4 other.mp4 --both-pages --quality

Two ends on this host's loopback; a headless Chromium shows one of them.  The source is a clip whose
mouth opens at known times and sounds just then: a clock that a model of the face transmits.  With
--clips the ends have these two for cameras, and the page shows the first; nothing is known of their
mouths.  With --one-way the end with the page has a camera that sees nobody: about as much work as
if each end had a host of its own.  With --both-pages the page of the other end is open as well.
With --draws pages draw the faces by themselves, though they do it in software here; else the host
draws for them.  With --busy so many loops keep the cores busy beside it.  Prints a line of JSON:

    ready_s          from the start of the two ends until all open pages show the other person,
        browsers and their start included
    pictures_per_s   shown by the page
    receiving_cpu    CPU seconds a second of the four processes that receive and perhaps draw, two
        at each end
    delay_ms         median and 95th percentile from the moment a frame was taken to its picture
    stages_ms        the same of each part of the delay:
        packet       until the newest picture of its packet was taken
        coded        until that packet had come: queue, fit and code of the encoder, and the link
        drawn        until the picture was drawn, and a JPEG file
        page         until the page had got it
        playout      until it was shown: JPEG decoded, and the wait for its turn
    first_ms         the same of the first picture of each packet, for which all others wait
    sound_late_ms    by how much the sound that is played follows the mouth: more than 0, it is late
        null: not known, as one of them is not found again
    minutes_late_ms  the same in the first and in the last minute of more than two
    match            how well mouth and sound on the page correlate with those of the source
    quality          with --quality, of each page that is open: PSNR of the other's face and of the
        whole picture against the clip, dB, of a picture a second; too low where the host is so busy
        that a camera reads its clip late
"""

import argparse
import asyncio
import json
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.browser import Browser, find_browser
from benchmarks.call_delay.clip import SECONDS, is_open, write_clip, write_empty_clip
from benchmarks.call_delay.seen_pictures import Seen, pictures_of, seen_quality
from benchmarks.call_ends import first_told, page_of, start_end
from benchmarks.command import run
from benchmarks.measured_process import cpu_s
from benchmarks.played_letter import SOFTWARE_GL
from loopback.process_pair import busy_loops, free_port
from shared_model.arrays import Array, Integers
from shared_model.errors import UserError

# How long the two ends may take until they see each other, and how long the face then settles.
START_S, SETTLE_S = 180.0, 12.0
STEP_S, COARSE_S = 0.005, 0.05
# With less correlation a lag is not known.
MIN_MATCH = 0.5
# Times of arrival that differ by less are of one packet.
SAME_MS = 5.0
MINUTE_S = 60.0
# The name of the processes that receive, as the system lists them.
RECEIVING_WORKER = "drawing_worker"
# Notes what the page shows and plays when: [ms since 1970, brightness of the mouth, frame, when it
# was drawn, how long its packet was there then, when it came] and [ms since 1970, loudness].
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
  const [, , ...stages] = player.log[player.log.length - 1];
  seen.push([performance.timeOrigin + performance.now(), sum, player.index, ...stages]);
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
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--seconds", type=float, default=60.0, help="to measure")
    length.add_argument("--minutes", type=float, help="the same in minutes")
    parser.add_argument("--clips", nargs=2, type=Path, metavar=("SEEN", "OTHER"))
    parser.add_argument("--one-way", action="store_true", help="the end with the page sees nobody")
    parser.add_argument("--low-delay", action="store_true", help="packets of four pictures")
    parser.add_argument("--both-pages", action="store_true", help="open the page of either end")
    parser.add_argument("--draws", action="store_true", help="pages draw, in software")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy loops beside it")
    parser.add_argument(
        "--quality", action="store_true", help="compare what pages show with --clips"
    )
    options = parser.parse_args(argv)
    if options.quality and not options.clips:
        raise UserError("--quality compares with --clips: name them")
    program = find_browser()
    if program is None:
        raise UserError("Chromium is not installed")
    with TemporaryDirectory() as name:
        folder, more = Path(name), ["--low-delay"] if options.low_delay else []
        cameras = options.clips or [write_clip(folder)] * 2
        if options.one_way:
            cameras = [cameras[0], write_empty_clip(folder)]
        seconds = options.seconds if options.minutes is None else MINUTE_S * options.minutes
        pages = Pages(program, options.both_pages, options.draws)
        with busy_loops(options.busy):
            noted = measure(folder, pages, cameras, more, seconds, options.quality)
        found = figures(noted.seen, noted.heard, noted.begun_ms, knows_mouth=not options.clips)
        if options.quality:
            found["quality"] = [
                seen_quality(*each) for each in zip(cameras, noted.pictures, strict=False)
            ]
        found = {"ready_s": round(noted.ready_s, 1), **found}
        print(json.dumps({**found, "receiving_cpu": round(noted.receiving_cpu, 2)}))


@dataclass(frozen=True, slots=True)
class Notes:
    """What was noted of a call.

    seen, heard, begun_ms: see `figures`.  ready_s, receiving_cpu: see above.
    pictures: what the page shows, and that of the other end if it is open; empty: not asked for.
    """

    seen: Array
    heard: Array
    begun_ms: float
    ready_s: float
    receiving_cpu: float
    pictures: list[list[Seen]]


@dataclass(frozen=True, slots=True)
class Pages:
    """How the pages of a call are looked at.

    program: path of Chromium.  both: of either end, else of one.  draw: they draw faces.
    """

    program: str
    both: bool
    draw: bool

    def open(self, folder: Path, address: str) -> Browser:
        """A browser that looks at the page at `address`.  folder: for its profile."""
        flags = ["--autoplay-policy=no-user-gesture-required"]
        flags += SOFTWARE_GL if self.draw else ()
        browser = Browser(self.program, folder, 900, 760, *flags)
        browser.call("Page.navigate", url=f"{address}?draws" if self.draw else address)
        return browser


def measure(
    folder: Path,
    pages: Pages,
    cameras: Sequence[Path],
    more: Sequence[str],
    seconds: float,
    with_pictures: bool = False,
) -> Notes:
    """What is noted of a call of so many seconds.

    cameras: of the end that is seen, and of the one whose page is looked at.  more: options.
    with_pictures: also what the open pages show.
    """
    with ExitStack() as stack:
        where, start_s = f"127.0.0.1:{free_port()}", time.monotonic()
        listens = start_end(stack, "--listen", where, "--camera", str(cameras[0]), *more)
        sender = page_of(listens)
        page = page_of(start_end(stack, where, "--camera", str(cameras[1]), *more))
        browsers = [stack.enter_context(pages.open(folder / "browser", page))]
        if pages.both:
            browsers.append(stack.enter_context(pages.open(folder / "other", sender)))
        for browser in browsers:
            browser.wait("typeof players != 'undefined' && players[OTHER].shown > 0", START_S)
        ready_s = time.monotonic() - start_s
        time.sleep(SETTLE_S)
        browsers[0].value(NOTES)
        before_s = receiving_cpu_s()
        pictures = pictures_of(browsers if with_pictures else [], seconds)
        cpu = (receiving_cpu_s() - before_s) / seconds
        begun_ms, fps = asyncio.run(first_told(sender, _begun))
        seen, heard = (np.array(browsers[0].value(each)) for each in ("seen", "heard"))
        seen[:, 2] = begun_ms + 1000 / fps * seen[:, 2]
        return Notes(seen, heard, begun_ms, ready_s, cpu, pictures)


def receiving_cpu_s() -> float:
    """CPU seconds so far of the processes that receive, and perhaps draw, on this host."""
    total_s = 0.0
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (process / "comm").read_text().strip() == RECEIVING_WORKER:
                total_s += cpu_s(int(process.name))
    return total_s


def figures(
    seen: Array, heard: Array, begun_ms: float, knows_mouth: bool = True
) -> dict[str, object]:
    """The figures from what a page has shown and played.

    seen: (n, 6) ms since 1970, brightness of the mouth, when it was taken and drawn, how long its
    packet was there then, and when it came to the page.  heard: (n, 2) ms since 1970, loudness.
    begun_ms: when the clip began.
    """
    span_s = (seen[-1, 0] - seen[0, 0]) / 1000
    stages, is_first = stages_ms(seen), np.diff(packets(seen), prepend=-1) > 0
    found: dict[str, object] = {
        "pictures_per_s": round((len(seen) - 1) / span_s, 1),
        "delay_ms": _percentiles(seen[:, 0] - seen[:, 2]),
        "stages_ms": {name: _percentiles(each) for name, each in stages.items()},
        "first_ms": {name: _percentiles(each[is_first]) for name, each in stages.items()},
    }
    if not knows_mouth:
        return found
    late_ms, match = sound_late_ms(seen, heard, begun_ms)
    found |= {"sound_late_ms": late_ms, "match": match}
    if span_s > 2 * MINUTE_S:
        minutes = list[int | None]()
        for begin_ms in (seen[0, 0], seen[-1, 0] - 1000 * MINUTE_S):
            of_minute = [minute_of(notes, begin_ms) for notes in (seen, heard)]
            minutes.append(sound_late_ms(of_minute[0], of_minute[1], begun_ms)[0])
        found["minutes_late_ms"] = minutes
    return found


def minute_of(notes: Array, begin_ms: float) -> Array:
    """The notes (n, k) of a minute from a time on, ms."""
    after_ms = notes[:, 0] - begin_ms
    return notes[(after_ms >= 0) & (after_ms < 1000 * MINUTE_S)]


def sound_late_ms(seen: Array, heard: Array, begun_ms: float) -> tuple[int | None, list[float]]:
    """By how much the sound follows the mouth, and how well either is found; see `figures`."""
    picture_s, seen_match = lag_s((seen[:, 0] - begun_ms) / 1000, -seen[:, 1])
    sound_s, heard_match = lag_s((heard[:, 0] - begun_ms) / 1000, heard[:, 1])
    # The clip is repeated: so is a lag.
    late_s = (sound_s - picture_s + SECONDS / 2) % SECONDS - SECONDS / 2
    match = [round(seen_match, 2), round(heard_match, 2)]
    return round(1000 * late_s) if min(match) >= MIN_MATCH else None, match


def stages_ms(seen: Array) -> dict[str, Array]:
    """The parts (n,) of the delay of each picture, see above.  seen: see `figures`."""
    shown, taken, made, waited, came = seen[:, [0, 2, 3, 4, 5]].T
    arrived, packet = made - waited, packets(seen)
    newest = np.array([taken[packet == each].max() for each in range(packet[-1] + 1)])[packet]
    return {
        "packet": newest - taken,
        "coded": arrived - newest,
        "drawn": waited,
        "page": came - made,
        "playout": shown - came,
    }


def packets(seen: Array) -> Integers:
    """The number (n,) of each picture's packet, from 0 on.  seen: see `figures`."""
    arrived = seen[:, 3] - seen[:, 4]
    # Pictures of one packet have come at the same time, to the rounding of the times.
    return np.cumsum(np.diff(arrived, prepend=arrived[0]) > SAME_MS)


def _percentiles(values: Array) -> list[int]:
    return [round(float(np.percentile(values, each))) for each in (50, 95)]


def lag_s(time_s: Array, level: Array) -> tuple[float, float]:
    """By how much a level (n,) noted at times (n,) follows the mouth of the clip, and how well.

    The clip may have begun long before the first frame that was encoded.
    """

    def match(each_s: float) -> float:
        return float(np.corrcoef(is_open(time_s - each_s), level)[0, 1])

    coarse_s = max(np.arange(0, SECONDS, COARSE_S), key=match)
    best_s = max(np.arange(coarse_s - COARSE_S, coarse_s + COARSE_S, STEP_S), key=match)
    return float(best_s), match(best_s)


def _begun(told: dict[str, Any]) -> tuple[float, float] | None:
    """When the camera of an end has begun, ms since 1970, and its rate, as its page is told."""
    if told["kind"] == "costs" and told["begun_ms"]:
        return float(told["begun_ms"]), float(told["fps"])
    return None


if __name__ == "__main__":
    run(main)
