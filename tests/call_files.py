"""Call files that tests write without an encoder."""

from pathlib import Path

import cv2
import numpy as np

from protocol.call_file import CallWriter
from protocol.call_parameters import CallParameters
from protocol.model_packet import ModelPacket
from protocol.packets import serialise
from shared_model.geometry import FRONTAL
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAUS
from shared_model.shape_residual import control_points


def webp(colour: tuple[int, int, int]) -> bytes:
    done, data = cv2.imencode(".webp", np.full((64, 64, 3), colour, np.uint8))
    assert done
    return data.tobytes()


def call_file(path: Path) -> Path:
    """Write a call without frames: a green face in front of a blue wall, at 600 mm."""
    call = CallParameters("thesis", 160, 120, 25, 1, focal_px=220.0)
    model = ModelPacket(
        call,
        aau=(0,) * len(AAUS),
        reference_rotation=FRONTAL,
        reference_translation_mm=(0.0, 0.0, 600.0),
        reference_eau=(0,) * len(EAUS),
        residual=(0,) * (3 * len(control_points(generic_head()))),
        background=webp((200, 30, 30)),
        texture=webp((30, 200, 30)),
    )
    with CallWriter(path) as writer:
        writer.send(serialise(model))
    return path
