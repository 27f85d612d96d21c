"""Intelligibility and rate of each codec of the voice: prints the table of docs/sound.md.

    python -m benchmarks voice_table studio.mp4 portrait.mp4

Encoder, gate and decoder, without packets around them: ESTOI of the decoded speech against the
source, and bits a second.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.command import run
from benchmarks.voice_table.chain import measure
from encoder.sound.sound_file import has_sound
from loopback.report import markdown_table
from protocol.limits import VOICES
from shared_model.errors import UserError


def table(paths: Sequence[Path]) -> str:
    """The lines of the table, a codec a row."""
    head = ["codec"]
    for path in paths:
        head += [f"{path.stem}: ESTOI", f"{path.stem}: bit/s"]
    rows = list[list[str]]()
    for voice in VOICES[1:]:
        cells = [voice]
        for path in paths:
            intelligibility, rate_bps = measure(path, voice)
            cells += [f"{intelligibility:.3f}", f"{rate_bps:.0f}"]
        rows.append(cells)
    return markdown_table(head, rows)


def main(arguments: Sequence[str]) -> None:
    """Print the table of the given files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("files", nargs="+", type=Path, help="videos with speech")
    options: Any = parser.parse_args(arguments)
    for path in options.files:
        if not has_sound(path):
            raise UserError(f"{path} has no sound")
    print(table(options.files))


if __name__ == "__main__":
    run(main)
