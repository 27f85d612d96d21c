"""Irises: where real eyes have them, and gaze from known geometry."""

from pathlib import Path

import numpy as np
import pytest
from conftest import ClipFrames

from encoder.capture import Frame
from encoder.detect import BlazeFaceDetector
from encoder.iris import LIDS, Eyes, IrisFinder, gaze
from encoder.landmarks import FaceMesh, LandmarkTracker
from encoder.square import square_from_landmarks
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.jaw_and_lids import GAZE_DEG, eye
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS

HEAD, CAMERA = generic_head(), Camera(640, 480, 800.0)
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))


@pytest.mark.parametrize("turn", [(0, 0), (20, 0), (-15, 10), (5, -12)])
@pytest.mark.parametrize("yaw", [-20.0, 0.0, 25.0])
def test_gaze_is_recovered_whatever_the_pose(turn: tuple[float, float], yaw: float) -> None:
    pose = pose_from_euler(-6, yaw, 9, np.array([40.0, 20, 600]))
    left, up = np.radians(turn)
    look = np.array([np.sin(left) * np.cos(up), np.sin(up), np.cos(left) * np.cos(up)])
    irises = np.zeros((2, 5, 2))
    for index, side in enumerate("rl"):
        ball = eye(HEAD.vertices, HEAD.parts, side)
        irises[index] = pixel_from_head(CAMERA, pose, ball.centre + ball.radius * look)
    found = gaze(FACE, CAMERA, pose, Eyes(irises, np.zeros((2, 71, 2))))
    assert found * GAZE_DEG == pytest.approx(turn, abs=0.1)


def test_an_iris_beyond_the_ball_still_gives_an_angle() -> None:
    pose = pose_from_euler(0, 0, 0, np.array([0.0, 0, 600]))
    eyes = Eyes(np.full((2, 5, 2), 600.0), np.zeros((2, 71, 2)))
    assert np.abs(gaze(FACE, CAMERA, pose, eyes)).max() <= 1


@pytest.mark.parametrize(
    ("name", "pupils"),
    [
        # Read off the first frame by hand, pixels.
        ("akiyo.mp4", [[156.5, 115.5], [190.5, 113]]),
        ("smile.mp4", [[259, 169], [326.5, 166]]),
    ],
)
def test_irises_are_where_the_pupils_are(
    name: str, pupils: list[list[float]], networks: Path, clip_frames: ClipFrames
) -> None:
    (frame,) = clip_frames(name, 1)
    found = LandmarkTracker(networks, BlazeFaceDetector(networks)).update(frame)
    assert found is not None
    centres = IrisFinder(networks).find(frame, found.points).irises[:, 0]
    eyes = np.linalg.norm(np.diff(pupils, axis=0))
    assert np.linalg.norm(centres - pupils, axis=1).max() < 0.05 * eyes, centres


def test_lids_close_in_a_blink(networks: Path, clip_frames: ClipFrames) -> None:
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    # The caller blinks in frame 42.
    opening = [eyes_opening(tracker, frame) for frame in clip_frames("carphone.mp4", 45)]
    assert min(opening) == opening[42] < 0.4 * np.median(opening)


def eyes_opening(tracker: LandmarkTracker, frame: Frame) -> float:
    found = tracker.update(frame)
    assert found is not None
    gaps = found.points[[159, 386], :2] - found.points[[145, 374], :2]
    eyes = found.points[263, :2] - found.points[33, :2]
    return float(np.linalg.norm(gaps, axis=1).mean() / np.linalg.norm(eyes))


def test_only_the_lids_are_seen_anew(networks: Path, clip_frames: ClipFrames) -> None:
    (frame,) = clip_frames("smile.mp4", 1)
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    found = tracker.update(frame)
    assert found is not None
    mesh = FaceMesh(networks).find(frame, square_from_landmarks(found.points))
    again = IrisFinder(networks).with_lids(frame, mesh.points)
    moved = np.flatnonzero((again != mesh.points).any(1))
    assert set(moved) <= set(np.ravel(LIDS))
    assert len(moved) > 20
    eyes = np.linalg.norm(mesh.points[263, :2] - mesh.points[33, :2])
    assert np.linalg.norm(again - mesh.points, axis=1).max() < 0.15 * eyes
