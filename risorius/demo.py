"""A call from end to end on a clip that is installed."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from decoder.pipeline import DecodeOptions, decode
from decoder.sinks.frame_sink import open_sink
from encoder.capture.video_source import open_source
from encoder.option_rules import available_profile
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from loopback.bench import make_folder
from loopback.clip_paths import CARPHONE, clip_path
from loopback.judge.comparison import compare, observe_source
from loopback.judge.observer import find_observer
from loopback.quality.region_quality import RegionQuality
from loopback.quality.video_quality import Quality
from loopback.report import Cell, table
from protocol.summary import CallSummary, summarise
from shared_model.arrays import Picture
from shared_model.errors import UserError

SHEET_COLUMNS = 6
# Smaller pictures are enlarged by a whole number.
SHEET_PICTURE_PX = 240
LABELS = ("source", "decoded")


def demo(folder: Path, say: Callable[[str], None], stop: Callable[[], bool]) -> str:
    """Encode and decode the demo clip, leave a video and a contact sheet in `folder`.

    Returns what to print.  Raises `UserError` if the clip is not installed.
    """
    source = str(clip_path(CARPHONE, Path()))
    make_folder(folder)
    call, decoded = folder / "call.rzo", folder / "decoded.mkv"
    say("demo: encode: two passes over a clip of four seconds, which takes up to half a minute")
    report = encode(EncodeOptions(source, call, profile=available_profile()), _ignore, stop)
    for warning in report.warnings:
        say(f"risorius: warning: {warning}")
    say("demo: decode")
    decode(DecodeOptions(call_file=call, output=decoded), _ignore, stop)
    say("demo: compare")
    observer = find_observer()
    view = observe_source(source, observer)
    quality = compare(view, str(decoded), observer, _ignore, say, with_faces=False).quality
    both, sheet = folder / "side_by_side.mp4", folder / "contact_sheet.png"
    write_side_by_side(source, decoded, both)
    write_contact_sheet(source, decoded, sheet, quality.frames)
    return "\n\n".join(
        [
            _size_table(summarise(call)),
            _quality_table(quality),
            f"also written: {call} {decoded} {sheet}",
            f"{headline(summarise(call), quality)}\nsource and call side by side: {both}",
        ]
    )


def headline(summary: CallSummary, quality: Quality) -> str:
    """The rate, the PSNR of the face and the size of a minute, in a line."""
    minute_bytes = summary.model_bytes + 60 * summary.record_bps / 8
    face_db = quality.face_psnr_db
    psnr = "" if face_db is None else f", {face_db:.1f} dB over the face"
    return (
        f"{summary.frame_bps:.0f} bits a second{psnr};"
        f" a minute of such a call weighs {minute_bytes / 1000:.1f} kB"
    )


def write_side_by_side(source: str, decoded: Path, output: Path) -> None:
    """Write a video of the source, left, and what was decoded, right."""
    with ExitStack() as stack:
        originals = stack.enter_context(open_source(source))
        copies = stack.enter_context(open_source(str(decoded)))
        size = (originals.width + copies.width, originals.height)
        sink = stack.enter_context(open_sink(output, *size, originals.fps, originals.colour_matrix))
        for (_, original), (_, copy) in zip(originals, copies, strict=True):
            sink.write(np.hstack([original, copy]))


def write_contact_sheet(source: str, decoded: Path, output: Path, frames: int) -> None:
    """Write one picture of frames evenly through the call: source above, decoded below."""
    chosen = np.linspace(0, frames - 1, SHEET_COLUMNS).round().astype(int).tolist()
    rows = [
        np.hstack(
            [_labelled(picture, f"{label} {index}") for index, picture in _pick(name, chosen)]
        )
        for label, name in zip(LABELS, (source, str(decoded)), strict=True)
    ]
    if not cv2.imwrite(str(output), np.vstack(rows)):
        raise UserError(f"cannot write {output}: no space or no permission")


def _pick(name: str, chosen: list[int]) -> Iterator[tuple[int, Picture]]:
    with open_source(name) as capture:
        for index, picture in islice(capture, max(chosen) + 1):
            yield from [(index, picture)] * chosen.count(index)


def _labelled(picture: Picture, text: str) -> Picture:
    zoom = -(-SHEET_PICTURE_PX // picture.shape[0])
    labelled = cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)
    for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(labelled, text, (5, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, thickness)
    return np.asarray(labelled, dtype=np.uint8)


def _size_table(summary: CallSummary) -> str:
    rows: list[list[Cell]] = [
        ["frames", summary.frames],
        ["duration, s", summary.duration_s],
        ["model packet, bytes", summary.model_bytes],
        ["frame packets, bytes", summary.frame_bytes],
        ["frame packets, bit/s", summary.frame_bps],
        ["call file, bytes", summary.file_bytes],
    ]
    return table((f"carphone, {summary.width}x{summary.height}", "value"), rows)


def _quality_table(quality: Quality) -> str:
    around = quality.regions or RegionQuality()
    person = "one picture, moved and lit by a few numbers a frame"
    scene = "one picture, learned from the whole call"
    if quality.regions is None:
        # Without the segmentation network both are in one picture.
        person = scene = "comes from one still picture"
    rows: list[list[Cell]] = [
        ["face", quality.face_psnr_db, around.face_ssimulacra2, "fitted and sent in every frame"],
        ["face, 5th percentile", quality.face_psnr_p5_db, None, "its worst frames"],
        ["hair, neck, shoulders", around.person_psnr_db, None, person],
        ["background", around.background_psnr_db, None, scene],
        ["whole picture", quality.full_psnr_db, around.picture_ssimulacra2, "all of these"],
    ]
    return table(("quality of the", "PSNR dB", "SSIMULACRA2", "why"), rows)


def _ignore(done: int, total: int | None) -> None:
    """No progress: `say` tells which step it is at."""
