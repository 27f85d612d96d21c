"""Writes the test vectors: `python tests/make_vectors.py` in the project's folder.

The calls are synthetic and small, and contain everything that docs/format.md specifies.  The files
are fixed: write them again only if the format changes.
"""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from layered_vectors import layered_background, with_layers
from packets import GOLDEN
from residual_vectors import with_residuals
from vector_contents import VECTORS, expected, frames_of

from encoder.picture_coding.picture_encoder import encode_mode, encode_picture
from protocol.call_file import MAGIC
from protocol.call_parameters import CallParameters
from protocol.call_records import serialise_records
from protocol.frames.frame_transform import (
    GEOMETRY_SIZE,
    MAX_BASIS_CODE,
    UNIT_CODE_OF_ONE,
    FrameTransform,
    with_reserved_modes,
)
from protocol.frames.payload_coding import PayloadHeader, encode_payload, parse_payload
from protocol.frames.scalar_quantiser import encode_thesis
from protocol.frames.temporal_prediction import (
    FramePredictor,
    coding_order,
)
from protocol.frames.transform_coding import serialise_transform
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    Packet,
    serialise,
)
from protocol.pictures.foreground_mask import MASK_SIDE, serialise_background
from protocol.pictures.picture_codec import (
    ModeCodec,
    to_planes,
)
from protocol.pictures.probability_model import TEXTURE
from protocol.pictures.weight_map import GRID_SIDE, encode_weight_map
from protocol.progressive_model import stream_item
from shared_model.arrays import Single
from shared_model.geometry import FRONTAL
from shared_model.parameters import AAUS, EAUS, FaceParameters, Pose

CALL = CallParameters(
    "default", 64, 48, 30000, 1001, 80.0, frames_per_packet=4, colour_matrix="bt709"
)
REFERENCE = Pose(np.array(FRONTAL), np.array([3.0, -5.0, 400.0]))
COMPONENTS, TEXTURE_SIZE = 3, 40


def picture(height: int, width: int, seed: int) -> Single:
    """A smooth picture (height, width, 3), BGR, with some noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width] / max(height, width)
    waves = [np.sin(2 * np.pi * (a * x + b * y)) for a, b in rng.uniform(-1.5, 1.5, (3, 2))]
    colours = 128 + 70 * np.stack(waves, -1) + rng.normal(0, 6, (height, width, 3))
    return np.clip(colours, 0, 255).astype(np.float32)


def pictures() -> tuple[bytes, bytes, list[bytes]]:
    """A background with a mask, a texture with a weight map, and three modes."""
    y, x = np.mgrid[:MASK_SIDE, :MASK_SIDE] / MASK_SIDE - 0.5
    mask = x**2 / 0.04 + y**2 / 0.08 < 1
    background = serialise_background(mask, encode_picture(picture(24, 33, 1), 24).serialise())
    cells = 2.0 ** np.linspace(-1, 1.5, GRID_SIDE)
    weight_map = encode_weight_map(np.minimum.outer(cells, cells[::-1]))
    texture = picture(TEXTURE_SIZE, TEXTURE_SIZE, 2)
    codec = ModeCodec(TEXTURE_SIZE, weight_map)
    modes = [
        encode_mode(codec, to_planes(picture(TEXTURE_SIZE, TEXTURE_SIZE, seed) - 128), step)
        for seed, step in ((3, 30), (4, 32), (5, 34))
    ]
    coded = encode_picture(texture, 28, weight_map, TEXTURE).serialise()
    return background, coded, [mode.serialise() for mode in modes]


def transform(modes: tuple[bytes, ...], components: int = COMPONENTS) -> FrameTransform:
    """Components that move pose, EAUs and modes together."""
    rng, d = np.random.default_rng(6), GEOMETRY_SIZE + len(modes)
    # Rotation (deg), shift (mm), log depth, EAUs.
    units = np.repeat(UNIT_CODE_OF_ONE - np.array([24, 8, 64, 40]), [3, 2, 1, len(EAUS)])
    scale_codes = 36 - 2 * np.arange(components)[:, None] - np.array([0, 6, 8, 10, 12])
    return FrameTransform(
        modes=modes,
        unit_codes=np.concatenate([units, np.full(len(modes), 120)]).astype(np.uint8),
        mean_codes=rng.integers(-9, 10, d),
        basis=rng.integers(-MAX_BASIS_CODE, MAX_BASIS_CODE + 1, (components, d), dtype=np.int8),
        exponents=rng.integers(-3, 1, components).astype(np.int8),
        scale_codes=scale_codes.astype(np.uint8),
    )


def frame_packets(
    frames: FrameTransform, first: int, payloads: list[tuple[int, int]]
) -> Iterator[bytes]:
    """Frame packets of a model; payloads: number of frames and of unused components of each."""
    rng = np.random.default_rng(7)
    predictor = FramePredictor(frames.scale_codes, frames.reserved_modes)
    n = len(frames.basis)
    for index, (count, unused) in enumerate(payloads):
        values = []
        for frame in coding_order(count):
            residuals = np.rint(rng.laplace(0, 2, n)).astype(np.int64)
            residuals[n - unused :] = 0
            values.append((frame, residuals))
        if index == 1:
            # A magnitude with an escape code.
            values[0][1][0] = -100
        header = PayloadHeader(10 + index, count, intra=index == 0, unused_components=unused)
        payload = encode_payload(predictor, index, CALL.frames_per_packet, header, values)
        parsed = parse_payload(predictor, index, CALL.frames_per_packet, payload)
        predictor.anchor = parsed.frames[-1]
        yield serialise(FramePacket((first + index) % 64, payload))


def default_call() -> list[bytes]:
    """An extensible model, a layer with a mode, a lost face, and an update in layers."""
    background, texture, modes = pictures()
    known, update = transform(tuple(modes[:2])), transform((b"",) * 3, 4)
    model = ModelPacket(
        call=CALL,
        aau=tuple(range(-50, 60, 10)),
        reference_rotation=tuple(REFERENCE.rotation),
        reference_translation_mm=tuple(REFERENCE.translation_mm),
        reference_eau=(20, *(0,) * (len(EAUS) - 1)),
        background=background,
        texture=texture,
        residual=tuple(int(code) for code in 10 * np.sin(np.arange(180))),
        profile_data=serialise_transform(with_reserved_modes(known, 1)),
        sequence=62,
        extensible=True,
    )
    later = replace(
        model,
        call=replace(CALL, start_frame=16, focal_px=82.0),
        background=b"",
        texture=encode_picture(
            picture(TEXTURE_SIZE, TEXTURE_SIZE, 2), 56, kind=TEXTURE
        ).serialise(),
        profile_data=serialise_transform(update),
        version=1,
        version_count=2,
        sequence=2,
        progressive=True,
        extensible=False,
    )
    stream = b"".join(map(stream_item, (texture, b"", *modes)))
    before = list(
        frame_packets(with_reserved_modes(known, 1), 62, [(1, 1), (4, 1), (4, 0), (3, 0)])
    )
    after = list(frame_packets(update, 2, [(1, 0), (2, 0)]))
    first_layer = LayerPacket(0, 0, stream_item(b"") * 2 + stream_item(modes[2]))
    second_layers = [LayerPacket(1, 0, stream[:300]), LayerPacket(1, 1, stream[300:])]
    return [
        serialise(model),
        *before[:2],
        serialise(first_layer),
        before[2],
        serialise(later),
        before[3],
        serialise(ControlPacket(2, ControlKind.FACE_LOST, 13)),
        serialise(ControlPacket(2, ControlKind.FACE_FOUND, 15)),
        *map(serialise, second_layers),
        *after,
        serialise(ControlPacket(4, ControlKind.END, 20)),
    ]


def layered_call() -> list[bytes]:
    """A background with layers, and frames in which they move and change."""
    _, texture, modes = pictures()
    frames = with_layers(transform(tuple(modes[:1]), 5))
    model = ModelPacket(
        call=CALL,
        aau=(0,) * len(AAUS),
        reference_rotation=tuple(REFERENCE.rotation),
        reference_translation_mm=tuple(REFERENCE.translation_mm),
        reference_eau=(0,) * len(EAUS),
        background=layered_background(
            CALL.width, CALL.height, (picture(24, 33, 1), picture(20, 30, 4))
        ),
        texture=texture,
        profile_data=serialise_transform(frames),
    )
    return [
        serialise(model),
        *frame_packets(frames, 0, [(1, 0), (4, 0)]),
        serialise(ControlPacket(2, ControlKind.END, 5)),
    ]


def thesis_call() -> list[bytes]:
    """Ten faces a second, with eyelids; a lost face; the pictures are those of the default call."""
    background, texture, _ = pictures()
    model = ModelPacket(
        call=replace(CALL, profile="thesis", frames_per_packet=1, has_eyelids=True),
        aau=(0,) * len(AAUS),
        reference_rotation=tuple(REFERENCE.rotation),
        reference_translation_mm=tuple(REFERENCE.translation_mm),
        reference_eau=tuple(range(len(EAUS))),
        background=background,
        texture=texture,
    )
    rng = np.random.default_rng(8)
    packets: list[Packet] = [model]
    for index in (0, 1, 2, 4):
        translation = REFERENCE.translation_mm + rng.normal(0, 20, 3)
        face = FaceParameters(Pose(REFERENCE.rotation, translation), rng.uniform(0, 1, len(EAUS)))
        packets.append(FramePacket(index, encode_thesis(face, REFERENCE, with_eyelids=True)))
    packets.insert(4, ControlPacket(3, ControlKind.FACE_LOST, 7))
    packets.insert(5, ControlPacket(3, ControlKind.FACE_FOUND, 11))
    packets.append(ControlPacket(5, ControlKind.END, 13))
    return list(map(serialise, packets))


def main() -> None:
    """Write calls and single packets in hexadecimal digits, and what calls and frames contain."""
    calls = {
        "call_default": default_call(),
        "call_layers": layered_call(),
        "call_residual": with_residuals(layered_call()),
        "call_thesis": thesis_call(),
    }
    for name, packets in calls.items():
        data = MAGIC + serialise_records(packets)
        lines = [data.hex()[start : start + 96] for start in range(0, 2 * len(data), 96)]
        (VECTORS / f"{name}.hex").write_text("\n".join(lines) + "\n")
        indent = None if name == "call_residual" else 1
        text = json.dumps(expected(packets), indent=indent)
        (VECTORS / f"{name}.json").write_text(text + "\n")
        print(f"{name}: {len(data)} bytes, {len(packets)} packets")
    for name, reserved in (("frames_default", 0), ("frames_reserved", 6)):
        (VECTORS / f"{name}.json").write_text(json.dumps(frames_of(name, reserved)) + "\n")
    for name, packet in GOLDEN.items():
        data = serialise(packet)
        (VECTORS / f"{name}.hex").write_text(data.hex() + "\n")
        print(f"{name}: {len(data)} bytes")


if __name__ == "__main__":
    main()
