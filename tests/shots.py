"""Pictures of the generic head drawn from a script, with their ground truth."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from encoder.capture.face_crop import Crop
from risorius.animation.animate import AnimateReport, animate
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, FaceParameters, Pose

# A face that turns, speaks and winks, 150 pixels wide.
SCRIPT = """
width = 320
height = 240
fps = 10
seconds = 0.7
distance_mm = 500
[[key]]
time = 0
pose = { yaw = -8, pitch = 2 }
eau = { jaw_drop = 0.1, mouth_corners = 0, lid_left = 0, lid_right = 0, eyebrow_middle = 0 }
[[key]]
time = 0.3
pose = { yaw = 2, pitch = -3, roll = 4 }
eau = { jaw_drop = 0.6, mouth_corners = 0.5, lid_left = 0.6, lid_right = 0, eyebrow_middle = 0.5 }
[[key]]
time = 0.6
pose = { yaw = 9, pitch = 3, roll = -3 }
eau = { jaw_drop = 0.3, mouth_corners = -0.4, lid_left = 0, lid_right = 0.3, eyebrow_middle = 0 }
"""


@dataclass(frozen=True, slots=True)
class Shots:
    """pictures: (h, w, 3) uint8 BGR.  points: (468, 2) landmarks, pixels, NaN where unknown."""

    camera: Camera
    face: Face
    pictures: list[Picture]
    faces: list[FaceParameters]
    points: list[Array]


def talking(
    seconds: float, fps: int = 25, width: int = 160, height: int = 120, smile: float = 0
) -> str:
    """The script of a small face that turns, speaks and, if told to, smiles in between."""
    return f"""
width = {width}
height = {height}
fps = {fps}
seconds = {seconds}
distance_mm = 420
noise = 1
[[key]]
time = 0
pose = {{ yaw = -6 }}
[[key]]
time = 0.5
eau = {{ jaw_drop = 0.6, mouth_corners = 0 }}
[[key]]
time = 1.2
pose = {{ yaw = 6, pitch = {4 * smile} }}
eau = {{ jaw_drop = 0.05, mouth_corners = {smile} }}
[[key]]
time = {seconds}
pose = {{ yaw = -4, pitch = 0 }}
eau = {{ jaw_drop = 0.6, mouth_corners = 0 }}
"""


def draw(output: Path, script: str) -> AnimateReport:
    """Draw a script into a video or a pattern of images; write the script to the same folder."""
    path = output.with_name("script.toml")
    path.write_text(script)
    return animate(path, output, lambda done, total: None, lambda: False)


def draw_shots(folder: Path, script: str = SCRIPT) -> Shots:
    """Draw a script into `folder` and read it back."""
    report = draw(folder / "shot%03d.png", script)
    truth = json.loads(report.truth.read_text())
    pictures = [cv2.imread(str(folder / f"shot{i:03d}.png")) for i in range(report.frames)]
    frames = truth["frames"]
    camera = Camera(truth["width"], truth["height"], frames[0]["focal_px"])
    head = generic_head()
    unknown = [np.nan, np.nan]
    return Shots(
        camera,
        Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices))),
        [np.asarray(picture, np.uint8) for picture in pictures],
        [
            FaceParameters(
                Pose(np.array(f["rotation"]), np.array(f["translation_mm"])), np.array(f["eau"])
            )
            for f in frames
        ],
        [np.array([point or unknown for point in f["network_px"]]) for f in frames],
    )


def whole(picture: Picture) -> Crop:
    """The crop of a whole picture."""
    return Crop(picture, 0, 0, np.ones(2))
