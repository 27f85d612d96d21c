"""What a decoder of ours makes of a call, in integers; `test_player/played_integers.js` says what
the player makes of the same bytes.

A call is a file, or events of a link: arrivals, and times at which nothing has come.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from packet_integers import COARSE, FINE, OF_EAU, guarded, model_fields, on_grid

from decoder.playout.playout import PlayoutFrame
from decoder.playout.receiver import Receiver
from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.frames.transform_coding import parse_transform
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.pictures.foreground_mask import parse_background
from protocol.pictures.layered_background import change_codec, is_layered, parse_layers
from protocol.pictures.picture_codec import (
    MAX_STEP_CODE,
    ModeCodec,
    is_picture,
    parse_picture_header,
    plane_shapes,
)
from protocol.pictures.plane_decoding import decode_planes
from protocol.pictures.subband_coding import PictureSequence

# An arrival at a time, or nothing.
Event = Arrival | float
MAX_SIDE_PX = 1024


@dataclass(slots=True)
class Played:
    """What a call is in integers.

    frames: of each shown frame its event (0 in a file), index, time, whether it is frozen and lost,
        presence, place of its model in `models`, pose, EAUs, coefficients of layers and modes, and
        the residual: first frame, frames, CRC-32 of its bytes.
    models: each with what layers had brought by then.
    pictures: of a file CRC-32 of all coefficients of each picture, of the last state of each
        version of the model; -1: of another codec; -2: damaged.
    residuals: CRC-32 of flags and values of each residual; -2: damaged.
    spoken: over a link, of a voice in Opus, number and CRC-32 of each speech frame.
    damages: number of packets and records that were refused.
    """

    frames: list[list[int]] = field(default_factory=list)
    models: list[list[int]] = field(default_factory=list)
    pictures: list[list[int]] = field(default_factory=list)
    residuals: list[int] = field(default_factory=list)
    spoken: list[list[int]] = field(default_factory=list)
    damages: int = 0
    ended: bool = False


def played_file(path: Path) -> Played:
    """What is in a call file, which may be damaged."""
    errors = list[ProtocolError]()
    receiver, frames = Receiver(on_damage=errors.append), list[tuple[int, PlayoutFrame]]()
    with CallReader(path) as reader:
        for data in reader.undamaged(errors.append):
            frames += [(0, frame) for frame in receiver.receive(Arrival(data, 0.0))]
    played = _played(frames, receiver, len(errors))
    states = {frame.model.version: frame.model for _, frame in frames}
    played.pictures = [_pictures(model) for model in states.values()]
    return played


def played_link(events: Sequence[Event]) -> Played:
    """What arrives over a link."""
    errors = list[ProtocolError]()
    receiver = Receiver(on_damage=errors.append, kept_speech_s=1 << 30)
    frames = list[tuple[int, PlayoutFrame]]()
    for place, event in enumerate(events):
        shown = receiver.receive(event) if isinstance(event, Arrival) else receiver.poll(event)
        frames += [(place, frame) for frame in shown]
    played = _played(frames, receiver, len(errors))
    if receiver.model is not None and receiver.model.call.voice == "opus":
        numbers = range(receiver.speech.received_until)
        speech = [(number, receiver.speech.get(number)) for number in numbers]
        played.spoken = [[number, crc32(frame)] for number, frame in speech if frame]
    return played


def write_events(path: Path, events: Iterable[Event]) -> None:
    """Write the events of a link for the player to read."""
    rows = [
        [event.time_s, event.session, event.number, event.data.hex()]
        if isinstance(event, Arrival)
        else [event]
        for event in events
    ]
    path.write_text(json.dumps(rows))


def _played(shown: list[tuple[int, PlayoutFrame]], receiver: Receiver, damages: int) -> Played:
    played, blocks = Played(damages=damages, ended=receiver.ended), dict[bytes, int]()
    for event, frame in shown:
        model = _model(frame.model)
        if model not in played.models:
            played.models.append(model)
        played.frames.append([event, *_frame(frame, played.models.index(model))])
        if frame.residual is not None and frame.residual.data not in blocks:
            (blocks[frame.residual.data],) = guarded(partial(_tiles, frame))
    played.residuals = list(blocks.values())
    return played


def _frame(frame: PlayoutFrame, model: int) -> list[int]:
    face, residual = frame.face, frame.residual
    of_residual = (
        [-1, 0, 0] if residual is None else [residual.first, residual.frames, crc32(residual.data)]
    )
    return [
        frame.index,
        *on_grid([float(frame.time_s)], FINE),
        frame.frozen,
        frame.lost,
        *on_grid([frame.presence], OF_EAU),
        model,
        *on_grid(face.pose.rotation, FINE),
        *on_grid(face.pose.translation_mm, COARSE),
        *on_grid(face.eau, OF_EAU),
        len(face.layers),
        *on_grid(face.layers, COARSE),
        len(face.modes),
        *on_grid(face.modes, COARSE),
        *of_residual,
    ]


def _tiles(frame: PlayoutFrame) -> list[int]:
    assert frame.residual is not None
    tiles = frame.residual.parse()
    values = tiles.values[tiles.flags > 0]
    parts = ([tiles.step_code], tiles.flags, values)
    return [crc32(b"".join(np.asarray(part).astype("<i4").tobytes() for part in parts))]


def _model(model: ModelPacket) -> list[int]:
    values = model_fields(model)
    if model.call.profile == "thesis":
        return values
    transform = parse_transform(model.profile_data)
    values += [transform.layers, transform.reserved_modes, len(transform.modes)]
    values += [crc32(mode) for mode in transform.modes]
    values += transform.scale_codes.flatten().tolist()
    values += on_grid(transform.mean, COARSE) + on_grid(transform.matrix.flatten(), COARSE)
    return [int(each) for each in values]


def _pictures(model: ModelPacket) -> list[int]:
    """CRC-32 of the coefficients of background, texture and modes."""
    of_background = guarded(partial(_background, model))
    return [*of_background, *guarded(partial(_appearance, model))]


def _appearance(model: ModelPacket) -> list[int]:
    found = [_picture("texture", model.texture)]
    if model.call.profile == "thesis" or not is_picture(model.texture):
        return found
    header = parse_picture_header("texture", model.texture)
    codec = ModeCodec(header.height, header.weight_map, header.width)
    for mode in parse_transform(model.profile_data).modes:
        if not mode:
            break
        found.append(_mode(codec, mode))
    return found


def _background(model: ModelPacket) -> list[int]:
    if not is_layered(model.background):
        mask, picture = parse_background(model.background)
        return [0 if mask is None else crc32(mask.tobytes()), _picture("background", picture)]
    call = model.call
    layers = parse_layers(model.background, call.width, call.height)
    codec = change_codec(call.width, call.height)
    return [
        crc32(layers.mask.tobytes()),
        *map(partial(_picture, "layer"), (layers.person, layers.scene)),
        crc32(layers.fields.astype("<i4").tobytes()),
        *(_mode(codec, change) for change in layers.changes),
        *(layers.scene_moves, layers.light_changes),
    ]


def _picture(name: str, data: bytes) -> int:
    """-1: of another codec."""
    if not is_picture(data):
        return -1
    header = parse_picture_header(name, data)
    if max(header.width, header.height) > MAX_SIDE_PX:
        raise ProtocolError(f"{name} is {header.width}x{header.height}")
    shapes = plane_shapes(header.height, header.width)
    return _next_crc(PictureSequence(header.kind), data[header.start :], shapes)


def _mode(codec: ModeCodec, data: bytes) -> int:
    return _next_crc(codec.sequence, data, plane_shapes(*codec.format.weight_map.shape))


def _next_crc(sequence: PictureSequence, data: bytes, shapes: list[tuple[int, int]]) -> int:
    """CRC-32 of the coefficients, after their step code, of the next picture of a sequence."""
    if not data or data[0] > MAX_STEP_CODE:
        raise ProtocolError("a picture has no step")
    crc = 0
    for plane in decode_planes(sequence, "picture", data[1:], shapes):
        for band in (plane.lowpass, *(band for level in plane.details for band in level)):
            crc = crc32(band.astype("<i4").tobytes(), crc)
    return crc


def as_json(played: Played) -> Any:
    """`Played` as the player's side writes it."""
    return {name: json.loads(json.dumps(getattr(played, name))) for name in played.__slots__}
