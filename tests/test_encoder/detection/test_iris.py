"""Irises and eyelids of real eyes."""

from pathlib import Path

import numpy as np
import pytest
from conftest import ClipFrames

from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.iris import TRAINED_CROP_SCALE, WIDE_CROP_SCALE, IrisLandmarker
from encoder.detection.landmark_indices import EYELID_MARGINS
from encoder.detection.landmarks import FaceMesh, LandmarkTracker
from encoder.detection.roi import roi_from_landmarks
from shared_model.arrays import Picture


@pytest.mark.parametrize(
    ("name", "pupils"),
    [
        # Read off the first frame by hand, pixels.
        ("akiyo.mp4", [[156.5, 115.5], [190.5, 113]]),
        ("smile.mp4", [[259, 169], [326.5, 166]]),
    ],
)
def test_irises_surround_the_pupils(
    name: str, pupils: list[list[float]], networks: Path, clip_frames: ClipFrames
) -> None:
    (frame,) = clip_frames(name, 1)
    found = LandmarkTracker(networks, BlazeFaceDetector(networks)).update(frame)
    assert found is not None
    centres = IrisLandmarker(networks).find(frame, found.points).irises[:, 0]
    eyes = np.linalg.norm(np.diff(pupils, axis=0))
    assert np.linalg.norm(centres - pupils, axis=1).max() < 0.05 * eyes, centres


@pytest.mark.parametrize("crop", [TRAINED_CROP_SCALE, WIDE_CROP_SCALE])
def test_eyelids_close_in_a_blink(crop: float, networks: Path, clip_frames: ClipFrames) -> None:
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks), eye_crop_scale=crop)
    # The person blinks in frame 42.
    opening = [eyes_opening(tracker, frame) for frame in clip_frames("carphone.mp4", 45)]
    assert min(opening) == opening[42] < 0.4 * np.median(opening)


def eyes_opening(tracker: LandmarkTracker, frame: Picture) -> float:
    found = tracker.update(frame)
    assert found is not None
    gaps = found.points[[159, 386], :2] - found.points[[145, 374], :2]
    eyes = found.points[263, :2] - found.points[33, :2]
    return float(np.linalg.norm(gaps, axis=1).mean() / np.linalg.norm(eyes))


def test_only_the_eyelids_are_replaced(networks: Path, clip_frames: ClipFrames) -> None:
    (frame,) = clip_frames("smile.mp4", 1)
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    found = tracker.update(frame)
    assert found is not None
    mesh = FaceMesh(networks).find(frame, roi_from_landmarks(found.points))
    again = IrisLandmarker(networks).replace_eyelids(frame, mesh.points)
    moved = np.flatnonzero((again != mesh.points).any(1))
    assert set(moved) <= set(np.ravel(EYELID_MARGINS))
    assert len(moved) > 20
    eyes = np.linalg.norm(mesh.points[263, :2] - mesh.points[33, :2])
    assert np.linalg.norm(again - mesh.points, axis=1).max() < 0.15 * eyes
