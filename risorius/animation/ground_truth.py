"""The ground truth of an animation: pose, actuators and landmarks of each picture."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from risorius.animation.animation_script import AnimationState, Script
from shared_model.anatomy.muscle_fields import MUSCLE_NAMES
from shared_model.arrays import Array
from shared_model.errors import cannot_write
from shared_model.geometry import Camera, euler_deg, pixel_from_head
from shared_model.mesh import Head
from shared_model.parameters import AAUS, EAUS, Pose


@dataclass(frozen=True, slots=True)
class FrameGeometry:
    """One picture's camera, pose and vertices (n, 3) mm."""

    camera: Camera
    pose: Pose
    vertices: Array


def frame_truth(
    time_s: float, state: AnimationState, geometry: FrameGeometry, head: Head
) -> dict[str, Any]:
    """All that is known of one picture; see docs/animate.md."""
    pixels = pixel_from_head(geometry.camera, geometry.pose, geometry.vertices)
    corners, weights = head.triangles[head.network_triangles], head.network_weights
    network = (weights[..., None] * pixels[corners]).sum(1)
    known = head.network_triangles >= 0
    pitch, yaw, roll = euler_deg(geometry.pose)
    return {
        "time_s": round(time_s, 6),
        "focal_px": geometry.camera.focal_px,
        "rotation": _rounded(geometry.pose.rotation, 9),
        "translation_mm": _rounded(geometry.pose.translation_mm, 6),
        "pitch_yaw_roll_deg": _rounded(np.array([pitch, yaw, roll]), 5),
        "eau": _rounded(state.eau, 6),
        "muscle": _rounded(state.muscles, 6),
        "aau": _rounded(state.aau, 6),
        "brightness": round(state.brightness, 6),
        "side": round(state.side, 6),
        "landmarks_px": {
            name: _rounded(pixels[index], 2) for name, index in sorted(head.landmarks.items())
        },
        "network_px": [
            _rounded(point, 2) if seen else None for point, seen in zip(network, known, strict=True)
        ],
    }


def script_truth(script: Script, camera: Camera) -> dict[str, Any]:
    """What holds for every picture of a script."""
    return {
        "width": camera.width,
        "height": camera.height,
        "fps": [script.fps.numerator, script.fps.denominator],
        "noise": script.noise,
        "blur_px": script.blur_px,
        "seed": script.seed,
        "eaus": [eau.name for eau in EAUS],
        "muscles": list(MUSCLE_NAMES),
        "aaus": list(AAUS),
    }


def write_truth(path: Path, whole: Mapping[str, Any], frames: Sequence[Mapping[str, Any]]) -> None:
    """JSON with one line for each picture.  Raises `UserError` if it cannot be written."""
    lines = ",\n".join(json.dumps(frame, separators=(",", ":")) for frame in frames)
    text = json.dumps(whole, indent=2)[:-2] + f',\n  "frames": [\n{lines}\n]\n}}\n'
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise cannot_write(path, error) from error


def _rounded(values: Array, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
