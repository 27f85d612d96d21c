"""Quality during a paced start: bytes, seconds and PSNR after each layer of a model.

Each clip is encoded with all layers before its second frame packet.  Its PSNR over the whole clip
is measured after decoding the first layers only, for several numbers of layers.  Seconds are the
arrival times of the layers over a link that carries all packets, frames included, at the rate.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.command import run
from decoder.pipeline import DecodeOptions, decode
from encoder.coding.pacer import LayerPacer
from encoder.coding.progressive_model import LayeredModel
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from loopback.quality.video_quality import face_mask_finder, measure_quality
from loopback.report import markdown_table
from protocol.call_file import MAGIC, CallReader
from protocol.call_records import serialise_records
from protocol.entropy.varint import decode_varint
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, parse_packet, serialise
from shared_model.errors import UserError

# A rate at which all layers are sent after the first frame packet.
UNLIMITED_BPS = 1e8
# Numbers of layers with a row: texture, background, then modes.
LAYER_COUNTS = (0, 1, 2, 3, 4, 6, 10, 18)


@dataclass(frozen=True, slots=True)
class LayeredCall:
    """A call: base layer, one layer packet for each item, and all other packets, as bytes."""

    base: bytes
    layers: tuple[bytes, ...]
    frames: tuple[bytes, ...]

    @property
    def model(self) -> LayeredModel:
        """The model as `LayerPacer` takes it."""
        base = parse_packet(self.base)
        assert isinstance(base, ModelPacket)
        return LayeredModel(base, tuple(map(_item_of, self.layers)))

    def truncated_to(self, count: int) -> bytes:
        """A call file with the first `count` layers, all before the frames."""
        return MAGIC + serialise_records((self.base, *self.layers[:count], *self.frames))

    def bytes_until(self, count: int) -> int:
        """Bytes of the base layer and `count` layers in a call file."""
        return (
            len(self.truncated_to(count))
            - len(self.truncated_to(0))
            + len(serialise_records([self.base]))
        )


@dataclass(frozen=True, slots=True)
class TableRow:
    """Quality after a number of layers."""

    layers: int
    bytes: int
    seconds: float
    face_psnr_db: float


def encode_progressively(clip: str, path: Path, max_frames: int | None) -> LayeredCall:
    """The call of a clip in layers."""
    options = EncodeOptions(
        clip, path, profile="default", startup_bitrate=UNLIMITED_BPS, max_frames=max_frames
    )
    encode(options, lambda done, total: None, lambda: False)
    with CallReader(path) as reader:
        base, *others = reader
    layers = [data for data in others if isinstance(parse_packet(data), LayerPacket)]
    return LayeredCall(base, tuple(layers), tuple(data for data in others if data not in layers))


def arrival_times_s(call: LayeredCall, bitrate: float) -> list[float]:
    """When the base layer and each further layer has arrived over a link of `bitrate`."""
    pacer, model = LayerPacer(bitrate), call.model
    pacer.start(model)
    pacer.on_packet_sent(len(call.base))
    parameters = model.base.call
    slot_s = parameters.frames_per_packet * parameters.frame_step / parameters.fps
    frames = [data for data in call.frames if isinstance(parse_packet(data), FramePacket)]
    times_s, packets = [8 * len(serialise_records([call.base])) / bitrate], 0
    for data in cycle(frames):
        if not pacer.pending_items:
            return times_s
        packets, before = packets + 1, pacer.pending_items
        pacer.on_packet_sent(len(data))
        pacer.packets_due(slot_s)
        times_s += [packets * slot_s] * (before - pacer.pending_items)
    raise UserError("the call has no frame packets")


def measure_layers(clip: str, call: LayeredCall, bitrate: float, folder: Path) -> list[TableRow]:
    """The rows of one clip."""
    times, rows = arrival_times_s(call, bitrate), []
    for count in sorted(
        {*(row for row in LAYER_COUNTS if row < len(call.layers)), len(call.layers)}
    ):
        path, video = folder / "cut.rzo", folder / "cut.mkv"
        path.write_bytes(call.truncated_to(count))
        report = decode(DecodeOptions(path, output=video), lambda done, total: None, lambda: False)
        find_face = face_mask_finder(lambda message: print(message, file=sys.stderr))
        quality = measure_quality(
            clip, str(video), find_face, lambda done, total: None, report.frames
        )
        assert quality.face_psnr_db is not None
        rows.append(TableRow(count, call.bytes_until(count), times[count], quality.face_psnr_db))
    return rows


def unlayered_bytes(call: LayeredCall) -> int:
    """Approximate bytes of the model packet without layers."""
    model = call.model
    coarse = len(model.base.texture) + len(model.base.background)
    return len(serialise(model.base)) - coarse + sum(map(len, model.items))


def markdown(tables: dict[str, list[TableRow]]) -> str:
    """A table of all clips with a row for each number of layers."""
    head = [each for name in tables for each in (f"{name}: bytes", "s", "dB")]
    lines = list[list[str]]()
    labels = {0: "base layer", 1: "+ texture", 2: "+ background", 3: "+ 1 mode"}
    counts = sorted({row.layers for rows in tables.values() for row in rows})
    for count in counts:
        cells = [labels.get(count, f"+ {count - 2} modes")]
        for rows in tables.values():
            row = next((row for row in rows if row.layers == count), None)
            if row is None:
                cells += [""] * 3
            else:
                cells += [str(row.bytes), f"{row.seconds:.1f}", f"{row.face_psnr_db:.1f}"]
        lines.append(cells)
    return markdown_table(["received", *head], lines)


def main(arguments: Sequence[str]) -> None:
    """Print the table of the clips named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("clip", nargs="+")
    parser.add_argument("--bitrate", type=float, default=8000, help="of the link, bits a second")
    parser.add_argument("--max-frames", type=int)
    options: Any = parser.parse_args(arguments)
    tables = {}
    for clip in options.clip:
        print(f"startup_layers: {clip}", file=sys.stderr)
        with TemporaryDirectory() as name:
            folder, stem = Path(name), Path(clip).stem
            call = encode_progressively(clip, folder / "call.rzo", options.max_frames)
            tables[stem] = measure_layers(clip, call, options.bitrate, folder)
        seconds = 8 * unlayered_bytes(call) / options.bitrate
        print(f"{stem}: whole model {unlayered_bytes(call)} bytes, {seconds:.1f} s", flush=True)
    print(f"\nat {options.bitrate:g} bit/s:\n\n{markdown(tables)}")


def _item_of(packet: bytes) -> bytes:
    layer = parse_packet(packet)
    assert isinstance(layer, LayerPacket)
    _, used = decode_varint(layer.data)
    return layer.data[used:]


if __name__ == "__main__":
    run(main)
