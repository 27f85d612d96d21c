"""A live call's first second, gone through before it begins with a face that is not there.

What runs for the first time takes long: compiled loops are loaded then, or compiled on a machine
that never ran them, which takes some fifteen seconds.  No frame shall wait for that.
"""

from dataclasses import replace

import numpy as np

from encoder.calls.model_version import Learner
from encoder.capture.video_source import Capture
from encoder.coding.background import Still
from encoder.coding.gop import Cadence
from encoder.coding.model_packet import BUDGETS
from encoder.detection.landmark_indices import COUNT
from encoder.fitting.identity import TYPICAL_FOCAL
from encoder.fitting.landmark_fit import landmark_model
from encoder.learning.incremental_modes import Grower
from shared_model.geometry import Camera, camera_from_head, pixel_from_camera, pose_from_euler
from shared_model.mesh import Head

# How far away the face is, and what its model takes.
AWAY_MM = 600.0
BYTES, MODES, FRAMES = 1500, 2, 4
# Grey levels of the noise.
GREY = (100, 156)


def rehearse(head: Head, capture: Capture, cadence: Cadence, rng: np.random.Generator) -> None:
    """Learn, find and go on learning a face of noise in pictures of the source's size."""
    width, height = capture.width, capture.height
    camera = Camera(width, height, TYPICAL_FOCAL * max(width, height))
    model = landmark_model(head)
    seen = camera_from_head(pose_from_euler(0, 0, 0, np.array([0, 0, AWAY_MM])), model.neutral)
    points = np.zeros((COUNT, 3))
    points[model.index, :2] = pixel_from_camera(camera, seen)
    points[model.index, 2] = (seen[:, 2] - AWAY_MM) * camera.focal_px / AWAY_MM
    pictures = list(rng.integers(*GREY, (FRAMES, height, width, 3), np.uint8))
    learner = Learner(head, capture, cadence, Still(pictures[0]), BYTES, 1)
    budget = replace(BUDGETS["live"], face_bytes=BYTES, background_bytes=BYTES, most_modes=MODES)
    epoch = learner.learn(budget, pictures, [points] * FRAMES, 0)
    looks = [epoch.look(picture, points) for picture in pictures]
    epoch.find(looks[0])
    Grower(epoch.learned.caller, epoch.explain).grow(looks, BYTES, 1)
