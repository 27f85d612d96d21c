"""The player beside the decoder: `python -m benchmarks player CLIP ...`.

Each clip is encoded and becomes a letter, which headless Chromium plays, drawing in software.  The
table: bytes of call and letter; PSNR between the pictures of page and decoder; face and whole PSNR
of either against the clip, the face as the judge finds it; then ms: until the first picture in a
browser that has been running, and in one that is just being started, there until all modes have
been decoded, of the worker for the first model, while the page opens and again when it is idle, of
drawing a frame.
Other programs on the machine are in these: --calls keeps the calls, and --times then takes seconds.

With --updates each clip becomes a live call, whose letter is played at its speed, first without and
then with another model each second, and so on: how many frames were not drawn in the first two
plays and, in the median, in three such pairs after them.
"""

import argparse
import tempfile
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from benchmarks.browser import find_browser
from benchmarks.command import run, warn
from benchmarks.played_letter import PlayedLetter
from decoder.call_pictures import CallPictures
from decoder.playout.call_source import CallSource
from decoder.sinks.frame_sink import open_sink
from loopback.clip_paths import videos_in
from loopback.judge.comparison import SourceView, observe_source
from loopback.judge.observer import Observer, find_observer
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.video_quality import Quality, measure_quality
from loopback.report import Cell, table
from risorius import encode
from risorius.letter.letter_file import write_letter
from shared_model.errors import UserError

SIZES = ("clip", "size", "call kB", "letter kB")
QUALITIES = (
    "page/decoder dB",
    "worst",
    "decoder: face",
    "whole",
    "page: face",
    "whole",
)
UPDATES = ("clip", "size", "frames", "models", "first play", "with models", "then", "with models")
UPDATE_S = 1.0
PAIRS = 3
TIMES = ("first ms", "starting ms", "decoded ms", "model ms", "idle ms", "frame ms")


def main(arguments: Sequence[str]) -> None:
    """Measure the clips and print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks player", description=__doc__)
    parser.add_argument("clips", nargs="+", metavar="CLIP", help="videos, or a folder of some")
    parser.add_argument("--max-frames", type=int, default=75, metavar="N", help="of each clip")
    parser.add_argument("--calls", metavar="FOLDER", help="keep the calls, and take those there")
    parser.add_argument("--times", action="store_true", help="only the times")
    parser.add_argument("--updates", action="store_true", help="frames lost as models come")
    options = parser.parse_args(arguments)
    program = find_browser()
    if program is None:
        raise UserError("letters are played by Chromium: apt-get install chromium")
    clips = [clip for each in options.clips for clip in videos_in(each)]
    if options.updates:
        print(table(UPDATES, [_updates(clip, options.max_frames, program) for clip in clips]))
        return
    header = (*SIZES, *(() if options.times else QUALITIES), *TIMES)
    observer = None if options.times else find_observer()
    if observer is not None:
        stand_in = "" if observer.is_independent else ": make judge installs another one"
        warn(f"player: the judge is {observer.name}{stand_in}")
    rows = []
    for clip in clips:
        with tempfile.TemporaryDirectory() as folder:
            call = Path(options.calls or folder) / f"{Path(clip).stem}.rzo"
            if not call.exists():
                encode(clip, call, max_frames=options.max_frames)
            rows.append(_row(clip, call, observer, program, Path(folder)))
        print(table(header, rows[-1:]), flush=True)
    print(f"\n{table(header, rows)}")


def _row(
    clip: str, call: Path, observer: Observer | None, program: str, folder: Path
) -> list[Cell]:
    """The cells of a clip.  observer: finds the face; None: only times are measured."""
    letter = folder / "letter.html"
    write_letter(call, letter, "letter", lambda lines: None)
    with PlayedLetter(program, folder / "running", letter, is_running=True) as played:
        played.wait_until_decoded()
        first_ms = played.shown_ms
    with PlayedLetter(program, folder / "profile", letter) as played:
        played.wait_until_decoded()
        width, height = played.size
        times = [
            first_ms,
            played.shown_ms,
            played.decoded_ms,
            played.model_ms,
            played.decode_again_ms(),
        ]
        times.append(played.frame_ms(min(50, played.frames)))
        qualities = [] if observer is None else _qualities(clip, call, observer, played, folder)
    sizes = [path.stat().st_size / 1e3 for path in (call, letter)]
    return [Path(clip).name, f"{width}x{height}", *sizes, *qualities, *times]


def _updates(clip: str, max_frames: int, program: str) -> list[Cell]:
    """The cells of a clip that is played while models come."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        call, letter = folder / "live.rzo", folder / "letter.html"
        encode(clip, call, live=True, max_frames=max_frames)
        write_letter(call, letter, "letter", lambda lines: None)
        with PlayedLetter(program, folder / "profile", letter) as played:
            played.wait_until_decoded()
            width, height = played.size
            plays = [
                (played.play_through(0), played.play_through(UPDATE_S)) for _ in range(1 + PAIRS)
            ]
    frames, models = plays[0][1].frames, plays[0][1].models
    lost = [[play.not_drawn for play in pair] for pair in plays]
    then = [int(count) for count in np.median(lost[1:], axis=0)]
    return [Path(clip).name, f"{width}x{height}", frames, models, *lost[0], *then]


def _qualities(
    clip: str, call: Path, observer: Observer, played: PlayedLetter, folder: Path
) -> list[Cell]:
    """Of the pictures of a page and of the decoder."""
    by_decoder, by_page = folder / "decoder.mkv", folder / "page.mkv"
    errors = list[float]()
    with CallPictures(CallSource(call_file=call), lambda: False) as pictures:
        sinks = None
        for frame in pictures:
            height, width = frame.picture.shape[:2]
            if sinks is None:
                fps = Fraction(pictures.sender.exact_fps)
                sinks = [open_sink(path, width, height, fps) for path in (by_decoder, by_page)]
            drawn = played.picture(frame.index)
            errors.append(float(np.mean(squared_error(frame.picture, drawn))))
            for sink, picture in zip(sinks, (frame.picture, drawn), strict=True):
                sink.write(picture)
        for sink in sinks or ():
            sink.close()
    between = [psnr_db(np.array(errors)), psnr_db(np.array([max(errors)]))]
    view = observe_source(clip, observer, len(errors))
    found = [_quality(view, path) for path in (by_decoder, by_page)]
    return [*between, *(db for each in found for db in (each.face_psnr_db, each.full_psnr_db))]


def _quality(view: SourceView, decoded: Path) -> Quality:
    finder, count = view.face_masks(), view.max_frames
    return measure_quality(
        view.source, str(decoded), finder, lambda done, total: None, count, is_strict=False
    )


if __name__ == "__main__":
    run(main)
