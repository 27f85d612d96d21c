"""Eyelids of two eyes of which one is looked at in a frame."""

from pathlib import Path

import numpy as np
from conftest import ClipFrames

from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.eyelids import eyelids_of_frame
from encoder.detection.iris import IrisLandmarker
from encoder.detection.landmark_indices import EYELID_MARGINS
from encoder.detection.landmarks import LandmarkTracker
from shared_model.arrays import Array, Picture


class Watched(IrisLandmarker):
    """Notes which eyes it looks at."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.sides: list[int] = []

    def margins(self, frame: Picture, points: Array, side: int) -> Array:
        self.sides.append(side)
        return super().margins(frame, points, side)


def test_the_eyes_take_turns_until_a_lid_moves(networks: Path, clip_frames: ClipFrames) -> None:
    frames = clip_frames("carphone.mp4", 45)
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks), refine_eyelids=False)
    eyes, both, eyelids = Watched(networks), IrisLandmarker(networks), None
    apertures, expected = [], []
    for frame in frames:
        found = tracker.update(frame)
        assert found is not None
        points, eyelids = eyelids_of_frame(eyes, frame, found.points, eyelids)
        apertures.append(opening(points))
        expected.append(opening(both.replace_eyelids(frame, found.points)))
    # The first frame, then one eye after the other while both rest.
    assert eyes.sides[:4] == [0, 1, 1, 0]
    assert len(eyes.sides) < 1.5 * len(frames)
    # The blink at frame 42 is as deep as with both.
    assert np.argmin(apertures) == np.argmin(expected) == 42
    assert min(apertures) < 1.05 * min(expected)
    # The error is small beside what a frame changes.
    error = np.array(apertures) - expected
    assert float((error**2).mean()) < 0.25 * float((np.diff(expected) ** 2).mean())


def test_the_same_picture_keeps_its_eyelids(networks: Path, clip_frames: ClipFrames) -> None:
    (frame,) = clip_frames("smile.mp4", 1)
    found = LandmarkTracker(networks, BlazeFaceDetector(networks), refine_eyelids=False).update(
        frame
    )
    assert found is not None
    eyes = Watched(networks)
    first, eyelids = eyelids_of_frame(eyes, frame, found.points, None)
    again, _ = eyelids_of_frame(eyes, frame, found.points, eyelids)
    np.testing.assert_allclose(again, first)
    assert eyes.sides == [0, 1, 1]


def opening(points: Array) -> float:
    """Mean height of both eyes, pixels."""
    margins = points[np.array(EYELID_MARGINS), :2]
    return float(np.linalg.norm(margins[:, 1:6] - margins[:, 8:13], axis=2).mean())
