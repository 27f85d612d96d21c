"""The player beside the decoder: `python -m benchmarks player CLIP ...`.

Each clip is encoded and becomes a letter, which headless Chromium plays, drawing in software.  The
table: bytes of call and letter; PSNR between the pictures of page and decoder; face and whole PSNR
of either against the clip; ms until the first picture, until all modes have been decoded, of the
worker for the first model, and of drawing a frame.
"""

import argparse
import tempfile
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from benchmarks.command import run, warn
from decoder.call_pictures import CallPictures
from decoder.playout.call_source import CallSource
from decoder.sinks.frame_sink import open_sink
from loopback.browser import find_browser
from loopback.clip_paths import videos_in
from loopback.played_letter import PlayedLetter
from loopback.quality.psnr import psnr_db, squared_error
from loopback.quality.video_quality import Quality, face_mask_finder, measure_quality
from loopback.report import Cell, table
from risorius import encode
from risorius.letter.letter_file import write_letter
from shared_model.errors import UserError

HEADER = (
    "clip",
    "size",
    "call kB",
    "letter kB",
    "page/decoder dB",
    "worst",
    "decoder: face",
    "whole",
    "page: face",
    "whole",
    "first ms",
    "decoded ms",
    "model ms",
    "frame ms",
)


def main(arguments: Sequence[str]) -> None:
    """Measure the clips and print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks player", description=__doc__)
    parser.add_argument("clips", nargs="+", metavar="CLIP", help="videos, or a folder of some")
    parser.add_argument("--max-frames", type=int, default=75, metavar="N", help="of each clip")
    options = parser.parse_args(arguments)
    program = find_browser()
    if program is None:
        raise UserError("letters are played by Chromium: apt-get install chromium")
    rows = []
    for clip in [clip for each in options.clips for clip in videos_in(each)]:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(_row(clip, options.max_frames, program, Path(folder)))
        print(table(HEADER, rows[-1:]), flush=True)
    print(f"\n{table(HEADER, rows)}")


def _row(clip: str, max_frames: int, program: str, folder: Path) -> list[Cell]:
    call, letter = folder / "call.rzo", folder / "letter.html"
    encode(clip, call, max_frames=max_frames)
    write_letter(call, letter, "letter", lambda lines: None)
    by_decoder, by_page = folder / "decoder.mkv", folder / "page.mkv"
    errors = list[float]()
    with (
        PlayedLetter(program, folder / "profile", letter) as played,
        CallPictures(CallSource(call_file=call), lambda: False) as pictures,
    ):
        played.wait_until_decoded()
        times = [played.shown_ms, played.decoded_ms, played.model_ms]
        times.append(played.frame_ms(min(50, played.frames)))
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
    qualities = [_quality(clip, path, len(errors)) for path in (by_decoder, by_page)]
    figures = [figure for each in qualities for figure in (each.face_psnr_db, each.full_psnr_db)]
    sizes = [path.stat().st_size / 1e3 for path in (call, letter)]
    between = [psnr_db(np.array(errors)), psnr_db(np.array([max(errors)]))]
    return [Path(clip).name, f"{width}x{height}", *sizes, *between, *figures, *times]


def _quality(clip: str, decoded: Path, frames: int) -> Quality:
    finder = face_mask_finder(warn)
    return measure_quality(clip, str(decoded), finder, lambda done, total: None, frames, False)


if __name__ == "__main__":
    run(main)
