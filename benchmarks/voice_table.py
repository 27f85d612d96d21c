"""Intelligibility and rate of each codec of the voice: prints the table of docs/sound.md.

    python -m benchmarks voice_table studio.mp4 portrait.mp4

Encoder, gate and decoder, without packets around them: ESTOI of the decoded speech against the
source, and bits a second.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import run
from decoder.sound.speech_decoder import open_speech_decoder
from decoder.sound.speech_frames import CallSpeech, SpeechFrames
from decoder.sound.voice_decoder import VoiceDecoder
from encoder.sound.recorded_speech import RecordedSpeech
from encoder.sound.sound_file import has_sound, read_sound
from loopback.quality.intelligibility import RATE_HZ, aligned, estoi, resampled
from loopback.report import markdown_table
from protocol.limits import VOICES
from protocol.voice.voice_block import serialise_frames
from shared_model.errors import UserError

# More frames than any file has.
ALL = 1 << 40


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


def measure(path: Path, voice: str) -> tuple[float, float]:
    """ESTOI, and bits a second, of the sound of a file in one codec."""
    frames = RecordedSpeech(path, voice).take(ALL)
    received = SpeechFrames()
    received.add(0, 0, tuple(frames))
    decoder = VoiceDecoder(CallSpeech(received), open_speech_decoder(voice))
    sound = np.concatenate([decoder.decode_next() for _ in frames]).astype(np.float64)
    source = np.concatenate(list(read_sound(path, RATE_HZ))).astype(np.float64)
    decoded = resampled(sound, decoder.rate_hz, RATE_HZ)
    bits = 8 * len(serialise_frames(voice, [frame for frame in frames if frame]))
    return estoi(*aligned(source, decoded, RATE_HZ)), bits * RATE_HZ / len(source)


if __name__ == "__main__":
    run(main)
