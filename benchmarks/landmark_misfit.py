"""Motion of faces that the model cannot reproduce: python -m benchmarks landmark_misfit CLIP...

Tracks the landmark network through clips, fits identity once, and pose and EAUs to each frame, and
prints the RMS residual motion of the landmarks about each point's mean, mm.
"""

import argparse
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from benchmarks.command import run
from encoder.capture.video_source import open_source
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import find_network_folder
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import fit_identity
from encoder.fitting.landmark_fit import LandmarkModel, fit_landmarks, landmark_model, personalise
from loopback.report import markdown_table
from shared_model.arrays import Array
from shared_model.geometry import pixel_from_head
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, EAUS, THESIS_EAUS, FaceParameters

# The network has no iris landmarks: the gaze EAUs would fit the eyelids.
GAZE_EAUS = ("gaze_horizontal", "gaze_vertical")
SETS: Mapping[str, tuple[int, ...]] = {
    "pose only": (),
    "the thesis' four": tuple(EAU_INDEX[name] for name in THESIS_EAUS),
    "all but gaze": tuple(i for i, eau in enumerate(EAUS) if eau.name not in GAZE_EAUS),
}
MOUTH = (
    *(61, 185, 40, 39, 37, 0, 267, 269, 270, 409, 291, 375, 321, 405, 314, 17, 84, 181, 91, 146),
    *(78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308, 324, 318, 402, 317, 14, 87, 178, 88, 95),
)
BROWS = (
    *(70, 63, 105, 66, 107, 46, 53, 52, 65, 55),
    *(336, 296, 334, 293, 300, 285, 295, 282, 283, 276),
)
EYELIDS = (
    *(33, 246, 161, 160, 159, 158, 157, 173, 133, 155, 154, 153, 145, 144, 163, 7),
    *(263, 466, 388, 387, 386, 385, 384, 398, 362, 382, 381, 380, 374, 373, 390, 249),
)
REGIONS = {"mouth": MOUTH, "brows": BROWS, "lids": EYELIDS}


def track_landmarks(clip: Path, frames: int, every: int) -> tuple[tuple[int, int], list[Array]]:
    """Picture size, and the landmarks (468, 3), pixels, of every `every`-th frame with a face."""
    folder = find_network_folder()
    tracker = LandmarkTracker(folder, BlazeFaceDetector(folder))
    with open_source(str(clip)) as source:
        pictures = islice(source, 0, frames, every)
        detections = [tracker.update(picture) for _, picture in pictures]
        size = source.width, source.height
    return size, [found.points for found in detections if found is not None]


def residual_motion(
    model: LandmarkModel, fitted: IdentityFit, landmarks: Sequence[Array], active: Sequence[int]
) -> Array:
    """(frames, points, 2) mm: the landmarks' residual after each fit, about its mean."""
    face = FaceParameters(fitted.frames[0].pose)
    residuals = []
    for points in landmarks:
        face = fit_landmarks(model, fitted.camera, points, face, active=active, iterations=6)
        fields = np.where((face.eau >= 0)[:, None, None], model.eau_up, -model.eau_down)
        vertices = model.neutral + np.tensordot(face.eau, fields, 1)
        projected = pixel_from_head(fitted.camera, face.pose, vertices)
        mm_per_px = face.pose.translation_mm[2] / fitted.camera.focal_px
        residuals.append((points[model.index, :2] - projected) * mm_per_px)
    residual = np.array(residuals)
    return np.asarray(residual - residual.mean(0))


def main(arguments: Sequence[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clips", nargs="+", type=Path, metavar="CLIP")
    parser.add_argument("--frames", type=int, default=120, help="frames of each clip (default 120)")
    parser.add_argument("--every", type=int, default=2, help="take one of so many (default 2)")
    options = parser.parse_args(arguments)
    head = generic_head()
    model = landmark_model(head)
    regions = {
        name: np.flatnonzero(np.isin(model.index, points)) for name, points in REGIONS.items()
    }
    squares: dict[str, list[list[float]]] = {name: [] for name in SETS}
    for clip in options.clips:
        size, landmarks = track_landmarks(clip, options.frames, options.every)
        fitted = fit_identity(
            head, size, [landmarks[0], landmarks[len(landmarks) // 2], landmarks[-1]]
        )
        personal = personalise(model, fitted.identity.aau, fitted.control_mm)
        for name, active in SETS.items():
            left = residual_motion(personal, fitted, landmarks, active)
            mean = [float((left[:, where] ** 2).sum(2).mean()) for where in regions.values()]
            squares[name].append(mean)
    lines = [
        [name, *(f"{v:.2f}" for v in np.sqrt(np.mean(rows, 0)))] for name, rows in squares.items()
    ]
    print(markdown_table(["actuators", *(f"{name}, mm" for name in regions)], lines))


if __name__ == "__main__":
    run(main)
