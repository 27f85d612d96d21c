"""What a letter weighs: `python -m benchmarks letter_size CLIP [--seconds S]`.

The clip, from its beginning again at its end until it is long enough, is encoded by the defaults,
its voice with it, and becomes a letter.  The table: bytes of the call, and of the letter.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import av
from av.container import InputContainer, OutputContainer

from benchmarks.command import run, warn
from loopback.report import table
from risorius import encode
from risorius.command_line.argument_types import seconds
from risorius.letter.letter_file import write_letter


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("clip", help="a video file")
    parser.add_argument("--seconds", type=seconds, default=60.0, help="how long (default: 60)")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        clip, call, letter = (Path(folder) / name for name in ("long.mkv", "call.rzo", "letter"))
        _repeat(options.clip, clip, options.seconds)
        encode(clip, call)
        size = write_letter(call, letter, "letter", _warn)
        row = [Path(options.clip).name, options.seconds, call.stat().st_size / 1e3, size / 1e3]
    print(table(("clip", "seconds", "call kB", "letter kB"), [row]))


def _warn(lines: Sequence[str]) -> None:
    for line in lines:
        warn(line)


def _repeat(source: str, output: Path, length_s: float) -> None:
    """Write pictures and sound of a video again and again, as they are coded, up to a length."""
    with av.open(str(output), "w") as joined:
        start_s = 0.0
        while start_s < length_s:
            with av.open(source) as clip:
                start_s += _append(clip, joined, start_s, length_s)


def _append(clip: InputContainer, joined: OutputContainer, start_s: float, end_s: float) -> float:
    """Append what begins before `end_s`; returns the length of the clip, seconds."""
    streams = [*clip.streams.video[:1], *clip.streams.audio[:1]]
    if not joined.streams:
        for stream in streams:
            joined.add_stream_from_template(stream)
    length_s = 0.0
    for packet in clip.demux(streams):
        if packet.dts is None or packet.pts is None or packet.time_base is None:
            continue
        ends_s = float((packet.pts + (packet.duration or 0)) * packet.time_base)
        length_s = max(length_s, ends_s)
        if start_s + ends_s > end_s:
            continue
        shift = round(start_s / packet.time_base)
        packet.pts, packet.dts = packet.pts + shift, packet.dts + shift
        packet.stream = joined.streams[streams.index(packet.stream)]
        joined.mux(packet)
    return length_s


if __name__ == "__main__":
    run(main)
