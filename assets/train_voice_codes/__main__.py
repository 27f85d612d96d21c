"""Train the prefix codes of Codec2 1200: prints the lengths of protocol/voice/codec2_bits.py.

    python -m assets.train_voice_codes en fr --held-out it

Each argument is a folder of sound files of one speaker, read one after the other.  Then, for each
folder, the bits of a speech frame with the codes in use, and with the new ones.  With other codes
than those in use calls can no longer be read: the codec needs another number on the wire.
Method: Huffman 1952, canonical.
"""

import argparse
import heapq
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import run
from encoder.sound.sound_file import read_sound
from encoder.sound.speech_coder import SpeechCoder
from encoder.sound.speech_encoder import open_speech_encoder
from protocol.voice.codec2_bits import (
    PITCH_ENERGY_LENGTHS,
    SPECTRUM_LENGTHS,
    STAGE_BITS,
    VOICING_LENGTHS,
    fields_1200,
)
from shared_model.arrays import Integers
from shared_model.errors import UserError

Lengths = Sequence[int]
Node = tuple[float, int, tuple[int, ...]]  # weight, smallest symbol, symbols

VOICE = "1200"
SUFFIXES = (".wav", ".flac", ".ogg", ".opus", ".mp3")
# Every symbol counts as if it came once more in so many frames: of it no speaker has too few.
RARE = 3500


def main(arguments: Sequence[str]) -> None:
    """Print the code lengths, and what they cost."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, help="of one speaker each")
    parser.add_argument("--held-out", nargs="*", type=Path, default=[], help="for the figures only")
    options: Any = parser.parse_args(arguments)
    folders = [*options.folders, *options.held_out]
    counts = [counted(folder) for folder in folders]
    trained = zip(*counts[: len(options.folders)], strict=True)
    codes = [code_lengths(np.sum(each, axis=0)) for each in trained]
    print("\n".join(as_digits(lengths) for lengths in codes))
    in_use = VOICING_LENGTHS, PITCH_ENERGY_LENGTHS, SPECTRUM_LENGTHS
    for folder, its_counts in zip(folders, counts, strict=True):
        print(f"{folder}: {bits(its_counts, in_use):.2f}, new {bits(its_counts, codes):.2f} bits")


def counted(folder: Path) -> tuple[Integers, ...]:
    """How often the speech of a folder has each voicing (16,), each pitch and energy (256,), and
    each first stage of the spectrum (512,)."""
    voicing, pitch_energy = np.zeros(16, np.int64), np.zeros(256, np.int64)
    spectrum = np.zeros(512, np.int64)
    for frame in speech_frames(folder):
        fields = fields_1200(frame)
        voicing[fields.voicing] += 1
        spectrum[fields.spectrum] += 1
        for index in fields.pitch_energy:
            pitch_energy[index] += 1
    return voicing, pitch_energy, spectrum


def speech_frames(folder: Path) -> list[bytes]:
    """The frames of all sounds in a folder that are spoken.  Raises `UserError` if none is."""
    encoder = open_speech_encoder(VOICE)
    coder = SpeechCoder(encoder, look_ahead=True)
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    pieces = chain.from_iterable(read_sound(path, encoder.rate_hz) for path in paths)
    coded = chain(chain.from_iterable(map(coder.push, pieces)), coder.finish())
    frames = [frame for frame in coded if frame is not None]
    if not frames:
        raise UserError(f"nobody speaks in {folder}")
    return frames


def code_lengths(counts: Integers) -> list[int]:
    """Lengths of a Huffman code, (n,); `RARE` bounds them."""
    weights = counts + counts.sum() / RARE
    heap: list[Node] = [(float(weight), i, (i,)) for i, weight in enumerate(weights)]
    heapq.heapify(heap)
    lengths = [0] * len(counts)
    while len(heap) > 1:
        (light, _, left), (heavy, _, right) = heapq.heappop(heap), heapq.heappop(heap)
        symbols = left + right
        for symbol in symbols:
            lengths[symbol] += 1
        heapq.heappush(heap, (light + heavy, min(symbols), symbols))
    return lengths


def bits(counts: Sequence[Integers], codes: Sequence[Lengths]) -> float:
    """Bits of a frame in the mean, with the other two stages of the spectrum."""
    coded = sum(int(each @ np.array(code)) for each, code in zip(counts, codes, strict=True))
    return 2 * STAGE_BITS + coded / int(counts[0].sum())


def as_digits(lengths: Iterable[int]) -> str:
    """Lengths as one hexadecimal digit each."""
    return "".join(f"{length:x}" for length in lengths)


if __name__ == "__main__":
    run(main)
