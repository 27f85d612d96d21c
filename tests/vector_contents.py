"""What the test vectors contain, as a decoder of ours finds it; see `make_vectors`."""

from pathlib import Path
from typing import Any

import numpy as np
from layered_vectors import decoded_layers
from residual_vectors import decoded_residuals

from decoder.playout.playout import Playout
from protocol.frames.payload_coding import parse_payload
from protocol.frames.temporal_prediction import MAX_SCALE_CODE, FramePredictor
from protocol.model_packet import ModelPacket
from protocol.packets import parse_packet
from protocol.pictures.foreground_mask import parse_background
from protocol.pictures.layered_background import is_layered
from protocol.pictures.picture_codec import decode_picture, parse_picture_header
from shared_model.arrays import Single

VECTORS = Path(__file__).parent / "vectors"


def expected(packets: list[bytes]) -> dict[str, Any]:
    """What a decoder finds in a call."""
    playout, frames, models = Playout(), [], []
    for packet in packets:
        for frame in playout.receive(parse_packet(packet)):
            face = frame.face
            frames.append(
                {
                    "frame": frame.index,
                    "frozen": frame.frozen,
                    "rotation": face.pose.rotation.tolist(),
                    "translation_mm": face.pose.translation_mm.tolist(),
                    "eau": face.eau.tolist(),
                    "modes": face.modes.tolist(),
                    **({"layers": face.layers.tolist()} if len(face.layers) else {}),
                }
            )
        if playout.model is not None and playout.model not in models:
            models.append(playout.model)
    assert playout.ended
    if models[0].call.has_residual:
        return {"residuals": decoded_residuals(packets)}
    if is_layered(models[0].background):
        return {"frames": frames, "layers": decoded_layers(models[0])}
    return {"frames": frames, "pictures": _pictures(models[0])}


def _pictures(model: ModelPacket) -> dict[str, Any]:
    mask, background = parse_background(model.background)
    found: dict[str, Any] = {}
    for name, data in (("background", background), ("texture", model.texture)):
        header = parse_picture_header(name, data)
        colours = decode_picture(name, data)
        found[name] = {"size": [header.width, header.height], "bgr": _rounded(colours)}
    assert mask is not None
    found["mask"] = ["".join("#" if cell else "." for cell in row) for row in mask]
    return found


def _rounded(colours: Single) -> list[list[float]]:
    """A row of pixels from the middle, B, G and R."""
    return [[round(float(value), 3) for value in pixel] for pixel in colours[len(colours) // 2]]


def frames_of(name: str, reserved: int) -> dict[str, Any]:
    """The contents of the frame packets in a file of payloads, which stays as it is."""
    start = np.array([40, 30, 28, 26, 24])
    scale_codes = np.clip(start - np.arange(20)[:, None], 0, MAX_SCALE_CODE)
    predictor, packets = FramePredictor(scale_codes, reserved), []
    for index, line in enumerate((VECTORS / f"{name}.hex").read_text().split()):
        parsed = parse_payload(predictor, index, 8, bytes.fromhex(line))
        predictor.anchor = parsed.frames[-1]
        header = parsed.header
        packets.append(
            {
                "quality": header.quality,
                "intra": header.intra,
                "unused": header.unused_components,
                "residuals": [
                    [frame.index, residuals.tolist()] for frame, residuals in parsed.values
                ],
                "frames": [frame.tolist() for frame in parsed.frames],
            }
        )
    return {
        "scale_codes": scale_codes.tolist(),
        "reserved": reserved,
        "frames_per_packet": 8,
        "packets": packets,
    }
