"""Hashes of calls and decoded pictures: python -m benchmarks call_hashes CLIPS [--against FILE]

Encodes four clips of the folder CLIPS in three profiles, decodes each call, and prints the SHA-256
of each call file and of its decoded pictures.  --out writes the list to a file; --against compares
it with such a file: a change of code that must not change calls is tested this way.  Hashes hold
for one machine, since processors round differently.
"""

import argparse
import hashlib
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.command import run
from encoder.capture.video_source import open_source
from shared_model.errors import UserError

# Clip and the number of its frames to encode; None: all.
CLIPS = {"carphone.mp4": None, "still.mpg": None, "smile.mp4": None, "akiyo.mp4": 250}
PROFILES = {"thesis": ("--profile", "thesis"), "default": (), "live": ("--live", "--no-pace")}


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("clips", type=Path, metavar="CLIPS", help="folder of the clips")
    parser.add_argument("--only", nargs="+", choices=CLIPS, default=list(CLIPS), metavar="CLIP")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the list to FILE as well")
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with this list")
    options = parser.parse_args(arguments)
    lines = list(hash_lines(options.clips, options.only))
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text("".join(f"{line}\n" for line in lines))
    if options.against:
        check_unchanged(options.against.read_text().splitlines(), lines)


def hash_lines(clips: Path, names: Sequence[str]) -> Iterator[str]:
    """Clip, profile, SHA-256 of the call file and of its decoded pictures; printed as they come."""
    for clip in names:
        frames = CLIPS[clip]
        for profile, options in PROFILES.items():
            limit = () if frames is None else ("--max-frames", str(frames))
            line = " ".join([clip, profile, *hashes(clips / clip, (*options, *limit))])
            print(line, flush=True)
            yield line


def hashes(source: Path, options: Sequence[str]) -> tuple[str, str]:
    """SHA-256 of one encoded call and of its decoded pictures."""
    with TemporaryDirectory() as folder:
        call, video = Path(folder, "call.rzo"), Path(folder, "call.mkv")
        _run("encoder", str(source), "-o", str(call), "-q", *options)
        _run("decoder", str(call), "-o", str(video), "-q")
        return hashlib.sha256(call.read_bytes()).hexdigest(), _picture_hash(video)


def _picture_hash(video: Path) -> str:
    digest = hashlib.sha256()
    with open_source(str(video)) as frames:
        for _, picture in frames:
            digest.update(picture.tobytes())
    return digest.hexdigest()


def _run(package: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-m", package, *arguments], check=True)


def check_unchanged(expected: Sequence[str], actual: Sequence[str]) -> None:
    """Raise `UserError` with the calls whose hashes differ."""
    changed = sorted(set(actual) - set(expected))
    if changed:
        names = ", ".join(" ".join(line.split()[:2]) for line in changed)
        raise UserError(f"calls have changed: {names}")
    print("all calls and pictures are as before")


if __name__ == "__main__":
    run(main)
