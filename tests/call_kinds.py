"""Small calls of all kinds, from a drawn face of a few pictures, as tests encode or change them."""

import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from call_contents import packets_of, raw_packets
from conftest import MakeOnce, without_layers
from recordings import record_part
from shots import draw, talking
from sounds import voiced_sound
from videos import read_frames

from decoder.drawn_call import draw_call
from decoder.sinks.frame_sink import open_sink
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from protocol.call_file import MAGIC
from protocol.call_records import serialise_records
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    PacketKind,
    packet_kind,
    serialise,
)
from shared_model.arrays import Picture

Options = dict[str, object]
SmallCall = Callable[[str], Path]
# Pictures a second of the drawn face.
FPS = 5
SOUND_HZ = 8000

# Names of calls, and the options by which the drawn face becomes them.
ENCODED: dict[str, Options] = {
    "live in packets of four": {"live": True, "low_delay": True},
    "picture residual": {"bitrate": 6000.0, "model_bytes": 4000, "draw": draw_call},
    "thesis": {"profile": "thesis"},
}
# Those of a face that speaks, and of other pictures of it.
SPEAKING: dict[str, Options] = {
    "voice of 700": {"voice": "700C", "live": True},
    "voice of 1200": {"voice": "1200", "profile": "thesis"},
    "voice of opus": {"voice": "opus", "profile": "thesis"},
}


def encoded(source: Path, path: Path, options: Options) -> None:
    """Encode a source with a small model."""
    every = EncodeOptions(str(source), path, **{"model_bytes": 3000, **options})  # type: ignore[arg-type]
    encode(every, lambda done, total: None, lambda: False)


def with_one_picture(source: Path, path: Path) -> None:
    """A call without layers, of every other picture."""
    with without_layers():
        encoded(source, path, {"fps": 2.0})


def speaking(source: Path, path: Path, options: Options) -> None:
    """The face with a sound track, as a call with a voice."""
    pictures, film = read_frames(source), path.with_suffix(".mkv")
    height, width = pictures[0].shape[:2]
    with open_sink(film, width, height, Fraction(FPS), sound_rate_hz=SOUND_HZ) as sink:
        for picture in pictures:
            sink.write(picture)
        sink.write_sound(voiced_sound(SOUND_HZ * len(pictures) // FPS))
    with without_layers():
        encoded(film, path, options)


def of_wide_pixels(source: Path, path: Path) -> None:
    """Pictures of Y'CbCr of BT.709 whose pixels are wider than high, at 30000/1001 a second."""
    rate, aspect = Fraction(30000, 1001), Fraction(12, 11)
    _filmed(read_frames(source), path, rate, "bt709", aspect, {"profile": "thesis"})


def upright(source: Path, path: Path) -> None:
    """A call of pictures that are higher than wide."""
    film = path.parent / "upright.mkv"
    draw(film, talking(2, FPS, width=120, height=160))
    encoded(film, path, {"profile": "thesis"})


def uneven(source: Path, path: Path) -> None:
    """Pictures at uneven distances."""
    pictures, film = read_frames(source), path.with_suffix(".mkv")
    height, width = pictures[0].shape[:2]
    with open_sink(film, width, height, Fraction(FPS), is_variable=True) as sink:
        for index, picture in enumerate(pictures):
            sink.write(picture, Fraction(index, FPS) + Fraction(index**2 % 7, 40))
    encoded(film, path, {"profile": "thesis"})


def found_again(source: Path, path: Path) -> None:
    """A face that is not there for two seconds."""
    pictures = read_frames(source)
    wall = [np.full_like(pictures[0], 90)] * 2 * FPS
    film = [*pictures, *wall, *pictures]
    with without_layers():
        _filmed(film, path, Fraction(FPS), "bt601", Fraction(1), {"live": True})


def with_late_layers(source: Path, path: Path) -> None:
    """A progressive model whose layers come one after each frame packet."""
    encoded(source, path, {"startup_bitrate": 20000.0, "low_delay": True})
    layers = [data for data in raw_packets(path) if packet_kind(data) is PacketKind.LAYER]
    found = list[bytes]()
    for data in raw_packets(path):
        kind = packet_kind(data)
        found += [] if kind is PacketKind.LAYER else [data]
        if kind is PacketKind.FRAME and layers:
            found.append(layers.pop(0))
    _write(path, found)


def _filmed(
    pictures: Sequence[Picture],
    path: Path,
    rate: Fraction,
    matrix: str,
    aspect: Fraction,
    options: Options,
) -> None:
    film, (height, width) = path.with_suffix(".mkv"), pictures[0].shape[:2]
    with open_sink(film, width, height, rate, matrix, sample_aspect=aspect) as sink:
        for picture in pictures:
            sink.write(picture)
    encoded(film, path, options)


# Calls of which each is encoded in its own way.
MADE: dict[str, Callable[[Path, Path], None]] = {
    "one picture, every other frame": with_one_picture,
    "wide pixels": of_wide_pixels,
    "upright": upright,
    "uneven times": uneven,
    "found again": found_again,
    "late layers": with_late_layers,
}


def at_rest(call: Path, path: Path) -> None:
    """The camera is off from the middle on, the face lost, gone and found."""
    found, numbers = list[bytes](), 0
    for packet, data in zip(packets_of(call), raw_packets(call), strict=True):
        if isinstance(packet, FramePacket):
            numbers += 1
            controls = _EVENTS.get(numbers, ())
            found += [serialise(ControlPacket(packet.sequence, *each)) for each in controls]
        found.append(data)
    _write(path, found)


# Before the frame packets with these places: 8 frames each, of which the first has one.
_EVENTS = {
    3: ((ControlKind.CAMERA_OFF, 9),),
    4: ((ControlKind.CAMERA_ON, 17), (ControlKind.FACE_LOST, 19), (ControlKind.PERSON_GONE, 21)),
    6: ((ControlKind.FACE_FOUND, 30),),
}


def from_the_middle(call: Path, path: Path) -> None:
    """A recording of the second half of a live call."""
    packets = raw_packets(call)
    record_part(path, packets, len(packets) // 2, len(packets))


def with_losses(call: Path, path: Path) -> None:
    """A file without some of its frame packets, with others twice or swapped."""
    source, found = random.Random(5), list[bytes]()
    for packet, data in zip(packets_of(call), raw_packets(call), strict=True):
        fate = source.random() if isinstance(packet, FramePacket) and len(found) > 3 else 1.0
        if fate > 0.3:
            found.append(data)
        if 0.2 < fate < 0.5:
            found.insert(-1 if fate < 0.4 else len(found), data)
    _write(path, found)


def damaged(call: Path, path: Path) -> None:
    """A file in which bytes are changed, missing and too many."""
    source, data = random.Random(8), bytearray(call.read_bytes())
    for _ in range(3):
        data[source.randrange(len(data) // 2, len(data))] ^= 1 << source.randrange(8)
        at = source.randrange(len(data) // 2, len(data) - 60)
        data[at : at + 5] = source.randbytes(source.choice((2, 9)))
    path.write_bytes(data)


def _write(path: Path, packets: Sequence[bytes]) -> None:
    path.write_bytes(MAGIC + serialise_records(packets))


# Calls that are made of a live one of three seconds.
CHANGED: dict[str, Callable[[Path, Path], None]] = {
    "lost and at rest": at_rest,
    "from the middle": from_the_middle,
    "with losses": with_losses,
    "damaged": damaged,
}


def call_of_kind(make_once: MakeOnce, slow_clip: Path, live_call: Path, name: str) -> Path:
    """The call with this name, made once in a test run."""

    def fill(folder: Path) -> None:
        path = folder / "call.rzo"
        if name in ENCODED:
            encoded(slow_clip, path, ENCODED[name])
        elif name in SPEAKING:
            pytest.importorskip("pycodec2")
            speaking(slow_clip, path, SPEAKING[name])
        elif name in MADE:
            MADE[name](slow_clip, path)
        else:
            CHANGED[name](live_call, path)

    return make_once(f"call {name}", fill) / "call.rzo"
