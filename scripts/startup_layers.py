"""What a paced start shows when: bytes, seconds and PSNR after each layer of a caller's model.

Each clip is encoded once with all layers before its second frame packet; decoded with the first
layers only, each number of them has its PSNR over the whole clip.  Seconds are when the link has
carried a layer, frames beside it, if all packets keep to the rate from the first byte on.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from decoder.pipeline import DecodeOptions, decode
from encoder.coding.pacer import LayerPacer
from encoder.coding.progressive_model import LayeredModel
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from loopback.quality import face_mask_finder, measure_quality
from protocol.call_file import MAGIC, CallReader, serialise_record
from protocol.entropy.varint import decode_varint
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, parse_packet, serialise
from scripts.command import run
from shared_model.errors import UserError

# So fast that every layer goes out at once.
AT_ONCE_BPS = 1e8
# After which numbers of layers there is a row: texture, background, modes.
ROWS = (0, 1, 2, 3, 4, 6, 10, 18)


@dataclass(frozen=True, slots=True)
class LayeredCall:
    """A call with its layers apart: packets as they are sent, one layer packet for each item."""

    first: bytes
    layers: tuple[bytes, ...]
    frames: tuple[bytes, ...]

    @property
    def model(self) -> LayeredModel:
        """The model as a pacer takes it."""
        first = parse_packet(self.first)
        assert isinstance(first, ModelPacket)
        return LayeredModel(first, tuple(map(_item_of, self.layers)))

    def cut(self, count: int) -> bytes:
        """A call file with the first `count` layers, all before the frames."""
        return MAGIC + b"".join(
            map(serialise_record, (self.first, *self.layers[:count], *self.frames))
        )

    def bytes_until(self, count: int) -> int:
        """What the first layer and `count` more take in a call file."""
        return len(self.cut(count)) - len(self.cut(0)) + len(serialise_record(self.first))


@dataclass(frozen=True, slots=True)
class Row:
    """What there is after so many layers."""

    layers: int
    bytes: int
    seconds: float
    face_psnr_db: float


def encoded(clip: str, path: Path, max_frames: int | None) -> LayeredCall:
    """A clip's call, with its layers apart."""
    options = EncodeOptions(
        clip, path, profile="default", startup_bitrate=AT_ONCE_BPS, max_frames=max_frames
    )
    encode(options, lambda done, total: None, lambda: False)
    with CallReader(path) as reader:
        first, *rest = reader
    layers = [data for data in rest if isinstance(parse_packet(data), LayerPacket)]
    return LayeredCall(first, tuple(layers), tuple(data for data in rest if data not in layers))


def arrivals_s(call: LayeredCall, bitrate: float) -> list[float]:
    """When the first layer and each of the others has come over a link of `bitrate`."""
    pacer, model = LayerPacer(bitrate), call.model
    pacer.start(model)
    pacer.on_packet_sent(len(call.first))
    parameters = model.base.call
    slot_s = parameters.frames_per_packet * parameters.frame_step / parameters.fps
    frames = [data for data in call.frames if isinstance(parse_packet(data), FramePacket)]
    found, slots = [8 * len(serialise_record(call.first)) / bitrate], 0
    for data in cycle(frames):
        if not pacer.pending_items:
            return found
        slots, before = slots + 1, pacer.pending_items
        pacer.on_packet_sent(len(data))
        pacer.packets_due(slot_s)
        found += [slots * slot_s] * (before - pacer.pending_items)
    raise UserError("the call has no frame packets")


def measured(clip: str, call: LayeredCall, bitrate: float, folder: Path) -> list[Row]:
    """The rows of one clip."""
    times, rows = arrivals_s(call, bitrate), []
    for count in sorted({*(row for row in ROWS if row < len(call.layers)), len(call.layers)}):
        path, video = folder / "cut.rzo", folder / "cut.mkv"
        path.write_bytes(call.cut(count))
        report = decode(DecodeOptions(path, output=video), lambda done, total: None, lambda: False)
        area = face_mask_finder(lambda message: print(message, file=sys.stderr))
        quality = measure_quality(clip, str(video), area, lambda done, total: None, report.frames)
        assert quality.face_psnr_db is not None
        rows.append(Row(count, call.bytes_until(count), times[count], quality.face_psnr_db))
    return rows


def whole_bytes(call: LayeredCall) -> int:
    """About what the model takes if it is sent whole."""
    model = call.model
    rough = len(model.base.texture) + len(model.base.background)
    return len(serialise(model.base)) - rough + sum(map(len, model.items))


def markdown(tables: dict[str, list[Row]]) -> str:
    """One table; a row for each number of layers."""
    names = list(tables)
    head = " | ".join(f"{name}: bytes | s | dB" for name in names)
    lines = [f"| has come | {head} |", "|---" * (1 + 3 * len(names)) + "|"]
    labels = {0: "first layer", 1: "+ texture", 2: "+ background", 3: "+ 1 mode"}
    counts = sorted({row.layers for rows in tables.values() for row in rows})
    for count in counts:
        cells = []
        for rows in tables.values():
            row = next((row for row in rows if row.layers == count), None)
            cells.append(
                f"{row.bytes} | {row.seconds:.1f} | {row.face_psnr_db:.1f}" if row else " |  | "
            )
        label = labels.get(count, f"+ {count - 2} modes")
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(lines)


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
            call = encoded(clip, folder / "call.rzo", options.max_frames)
            tables[stem] = measured(clip, call, options.bitrate, folder)
        seconds = 8 * whole_bytes(call) / options.bitrate
        print(f"{stem}: whole model {whole_bytes(call)} bytes, {seconds:.1f} s", flush=True)
    print(f"\nat {options.bitrate:g} bit/s:\n\n{markdown(tables)}")


def _item_of(packet: bytes) -> bytes:
    layer = parse_packet(packet)
    assert isinstance(layer, LayerPacket)
    _, used = decode_varint(layer.data)
    return layer.data[used:]


if __name__ == "__main__":
    run(main)
