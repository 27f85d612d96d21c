"""A small progressive model: its items, the layer packets that carry them, and its refinements."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from packets import CALL, MODEL

from encoder.coding.rdo_quantiser import code_packet
from protocol.call_file import CallWriter
from protocol.frames.frame_transform import GEOMETRY_SIZE, FrameTransform, with_reserved_modes
from protocol.frames.temporal_prediction import PREDICTION_KINDS, FramePredictor
from protocol.frames.transform_coding import parse_transform, serialise_transform
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, LayerPacket, serialise
from protocol.progressive_model import stream_item

ITEMS = (b"whole texture", b"whole background", b"first mode" * 20, b"second", b"third")
MODES = len(ITEMS) - 2


def transform_data(modes: tuple[bytes, ...], reserved: int = 0) -> bytes:
    """The serialised transform of frames with these modes and so many reserved ones."""
    d = GEOMETRY_SIZE + len(modes)
    tables = FrameTransform(
        modes,
        np.full(d, 128, np.uint8),
        np.zeros(d, np.int64),
        np.ones((2, d), np.int8),
        np.zeros(2, np.int8),
        np.full((2, PREDICTION_KINDS), 8, np.uint8),
    )
    return serialise_transform(with_reserved_modes(tables, reserved))


FIRST = replace(
    MODEL,
    call=replace(CALL, profile="default", frames_per_packet=8),
    version=3,
    version_count=4,
    progressive=True,
    texture=b"rough",
    background=b"rough, too",
    profile_data=transform_data((b"",) * MODES),
)
BASE = replace(FIRST, call=replace(FIRST.call, start_frame=0), sequence=0)
PACKED = FIRST.call.frames_per_packet
STREAM = b"".join(map(stream_item, ITEMS))
# A live call sends its model whole, then the modes that it learns.
KNOWN, LEARNED = (b"known", b"known, too"), (b"learned", b"learned later")
WHOLE = replace(FIRST, progressive=False, extensible=True, profile_data=transform_data(KNOWN, 3))


def learned_layers(*modes: bytes) -> list[LayerPacket]:
    """The layer packets of modes that are learned one by one, without pictures."""
    datas = [stream_item(b"") * 2 + stream_item(modes[0]), *map(stream_item, modes[1:])]
    return [LayerPacket(3, number, data) for number, data in enumerate(datas)]


def pieces(stream: bytes, cuts: list[int]) -> list[LayerPacket]:
    """A stream of items as layer packets, cut at these places modulo its length."""
    places = sorted({0, *(cut % len(stream) for cut in cuts), len(stream)})
    parts = [stream[a:b] for a, b in pairwise(places)]
    return [LayerPacket(3, number, data) for number, data in enumerate(parts)]


def expected(count: int) -> ModelPacket:
    """`FIRST` refined with the first `count` items."""
    found = [*ITEMS[:count], *[b""] * (len(ITEMS) - count)]
    return replace(
        FIRST,
        texture=found[0] or FIRST.texture,
        background=found[1] or FIRST.background,
        profile_data=transform_data(tuple(found[2:])),
    )


def frames(count: int, first: int = 0, model: ModelPacket = FIRST) -> list[bytes]:
    """Frame packets of a face that moves evenly, numbered from `first`."""
    transform = parse_transform(model.profile_data)
    predictor = FramePredictor(transform.scale_codes, transform.reserved_modes)
    speed = np.zeros(len(transform.basis))
    speed[:2] = 0.5, -0.3
    packets, start = [], 0
    for number in range(count):
        places = np.arange(start, start + (PACKED if number else 1))
        start = int(places[-1]) + 1
        values = places[:, None] * speed
        packet = code_packet(predictor, (first + number) % 64, PACKED, values, 0, intra=number == 0)
        predictor.anchor = packet.frames[-1]
        packets.append(serialise(FramePacket((first + number) % 64, packet.payload)))
    return packets


def write_call(path: Path, count: int) -> None:
    """A call file of `count` frame packets of `frames`, with its model and its end."""
    with CallWriter(path) as writer:
        for data in (serialise(BASE), *frames(count, model=BASE)):
            writer.send(data)
        end = 1 + PACKED * (count - 1)
        writer.send(serialise(ControlPacket(0, ControlKind.END, end)))
