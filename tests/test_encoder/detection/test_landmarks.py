"""Landmarks: geometry of the ROI, and consistency on real faces."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ClipFrames

from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.detector import Detection
from encoder.detection.landmark_indices import OUTER_EYE_CORNERS
from encoder.detection.landmarks import FaceMesh, Landmarks, LandmarkTracker
from encoder.detection.roi import RotatedRoi, roi_from_detection, roi_from_landmarks
from shared_model.arrays import Picture


def test_crop_corners_lie_on_the_roi() -> None:
    roi = RotatedRoi(np.array([100.0, 50.0]), 40.0, np.radians(90))
    affine = roi.pixel_from_crop(192)
    corners = np.array([[-0.5, -0.5], [191.5, -0.5]]) @ affine[:, :2].T + affine[:, 2]
    assert corners == pytest.approx(np.array([[120.0, 30.0], [120.0, 70.0]]))


def test_roi_of_landmarks_follows_shift_scale_and_roll() -> None:
    points = np.random.default_rng(3).uniform(0, 100, (468, 3))
    points[OUTER_EYE_CORNERS[0]], points[OUTER_EYE_CORNERS[1]] = [20, 50, 0], [80, 50, 0]
    before = roi_from_landmarks(points)
    after = roi_from_landmarks(points * 2 + [7.0, -3.0, 0.0])
    assert after.centre == pytest.approx(before.centre * 2 + [7, -3])
    assert after.side == pytest.approx(before.side * 2)
    assert after.roll_rad == before.roll_rad == 0


def test_roi_of_a_rolled_detection_is_rolled() -> None:
    keypoints = np.zeros((6, 2))
    keypoints[1] = [10, 10]
    roi = roi_from_detection(Detection(np.array([0.0, 0, 30, 40]), keypoints, 0.9))
    assert roi.roll_rad == pytest.approx(np.radians(45))
    assert roi.side == 60
    assert roi.centre == pytest.approx([15, 20])


def test_nothing_is_found_where_no_face_is(networks: Path) -> None:
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    assert tracker.update(np.full((120, 160, 3), 90, np.uint8)) is None
    assert tracker.face_count == 0


def test_mirrored_faces_give_mirrored_landmarks(networks: Path, clip_frames: ClipFrames) -> None:
    mesh, offsets = FaceMesh(networks), []
    for name in ("carphone.mp4", "akiyo.mp4", "smile.mp4", "still.mpg"):
        tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
        for frame in clip_frames(name, 6):
            found = tracker.update(frame)
            assert found is not None
            roi, last = roi_from_landmarks(found.points), frame.shape[1] - 1
            centre = np.array([last - roi.centre[0], roi.centre[1]])
            other = RotatedRoi(centre, roi.side, -roi.roll_rad)
            mirrored = mesh.find(np.ascontiguousarray(frame[:, ::-1]), other).points[:, 0]
            # The set of points is symmetric, hence so is its mean.
            middle = (mesh.find(frame, roi).points[:, 0].mean() + mirrored.mean()) / 2
            offsets.append((middle - last / 2) / roi.side * 192)
    assert abs(np.mean(offsets)) < 0.25, "half a pixel of the crop would show as 0.5"


def test_tracking_follows_a_face_moved_and_scaled(networks: Path, clip_frames: ClipFrames) -> None:
    (frame,) = clip_frames("smile.mp4", 1)
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    for _ in range(3):
        first = tracker.update(frame)
    move = np.array([[1.05, 0.0, 6.0], [0.0, 1.05, -4.0]])
    moved = cv2.warpAffine(frame, move, (frame.shape[1], frame.shape[0]), flags=cv2.INTER_CUBIC)
    for _ in range(3):
        second = tracker.update(np.asarray(moved, np.uint8))
    assert first is not None and second is not None
    expected = first.points[:, :2] @ move[:, :2].T + move[:, 2]
    distance = np.linalg.norm(expected - second.points[:, :2], axis=1)
    eyes = np.linalg.norm(np.diff(expected[list(OUTER_EYE_CORNERS)], axis=0))
    assert distance.mean() < 0.01 * eyes


def test_lost_face_is_found_again(networks: Path, clip_frames: ClipFrames) -> None:
    seen = clip_frames("akiyo.mp4", 2)
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    assert tracker.update(seen[0]) is not None
    assert tracker.update(np.zeros_like(seen[0])) is None
    again = tracker.update(seen[1])
    assert again is not None and again.score > 0.9


@pytest.mark.parametrize("name", ["carphone.mp4", "akiyo.mp4", "turn.mp4", "still.mpg"])
def test_a_face_is_tracked_through_a_real_clip(
    networks: Path, name: str, clip_frames: ClipFrames
) -> None:
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    for index, frame in enumerate(clip_frames(name, 60)):
        found = tracker.update(frame)
        assert found is not None and found.score > 0.7, f"frame {index}"


def test_prefetched_landmarks_are_the_same(
    networks: Path, clip_frames: ClipFrames, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[tuple[int, bool]] = []
    find = FaceMesh.find

    def recorded(mesh: FaceMesh, frame: Picture, roi: RotatedRoi) -> Landmarks:
        runs.append((id(frame), threading.current_thread() is threading.main_thread()))
        return find(mesh, frame, roi)

    frames = clip_frames("akiyo.mp4", 6)
    plain, ahead = (LandmarkTracker(networks, BlazeFaceDetector(networks)) for _ in range(2))
    expected = [plain.update(frame) for frame in frames]
    monkeypatch.setattr(FaceMesh, "find", recorded)
    for frame, next_frame, landmarks in zip(frames, [*frames[1:], None], expected, strict=True):
        found = ahead.update(frame, next_frame)
        assert landmarks is not None and found is not None
        assert (found.points == landmarks.points).all()
    assert runs[-5:] == [(id(frame), False) for frame in frames[1:]]


def test_a_new_roi_discards_what_was_prefetched(networks: Path, clip_frames: ClipFrames) -> None:
    first, second = clip_frames("akiyo.mp4", 2)
    found = LandmarkTracker(networks, BlazeFaceDetector(networks)).update(first)
    assert found is not None
    roi, nobody = roi_from_landmarks(found.points), Nobody()
    tracker = LandmarkTracker(networks, nobody)
    tracker.set_roi(roi)
    assert tracker.update(first, second) is not None
    tracker.set_roi(shifted(roi, 2.0))
    assert tracker.update(second) is None and nobody.asked == 1


def shifted(roi: RotatedRoi, share: float) -> RotatedRoi:
    """The ROI, shifted to the right by this share of its side."""
    return RotatedRoi(roi.centre + np.array([share * roi.side, 0]), roi.side, roi.roll_rad)


def turned(roi: RotatedRoi, rad: float) -> RotatedRoi:
    """The ROI, turned by a full turn and `rad`."""
    return RotatedRoi(roi.centre, roi.side, roi.roll_rad + 2 * np.pi + rad)


def test_an_equivalent_roi_changes_nothing(networks: Path, clip_frames: ClipFrames) -> None:
    first, second = clip_frames("akiyo.mp4", 2)
    plain, guided = (LandmarkTracker(networks, BlazeFaceDetector(networks)) for _ in range(2))
    found, same = plain.update(first), guided.update(first)
    assert found is not None and same is not None
    roi = roi_from_landmarks(found.points)
    guided.set_roi(shifted(roi, 0.05))
    assert roi.overlaps_closely(shifted(roi, 0.05)) and not roi.overlaps_closely(turned(roi, 0.5))
    expected, after = plain.update(second), guided.update(second)
    assert expected is not None and after is not None
    assert (after.points == expected.points).all()


class Nobody:
    """A detector that never finds a face, and counts how often it was asked."""

    def __init__(self) -> None:
        self.asked = 0

    def detect(self, frame: Picture) -> list[Detection]:
        self.asked += 1
        return []

    def detect_large(self, frame: Picture) -> list[Detection]:
        return []

    def detect_part(self, frame: Picture) -> list[Detection]:
        self.asked += 1
        return []


def test_detection_backs_off_while_there_is_no_face(networks: Path) -> None:
    nobody = Nobody()
    tracker = LandmarkTracker(networks, nobody)
    empty = np.zeros((120, 160, 3), np.uint8)
    for _ in range(4):
        assert tracker.update(empty) is None
    assert nobody.asked == 4
    for _ in range(90):
        assert tracker.update(empty) is None
    assert nobody.asked < 20


def test_a_search_by_parts_rests_while_there_is_no_face(networks: Path) -> None:
    nobody = Nobody()
    tracker = LandmarkTracker(networks, nobody, searches_by_parts=True)
    empty = np.zeros((120, 160, 3), np.uint8)
    for _ in range(16 + 100):
        assert tracker.update(empty) is None
    assert nobody.asked == 16 + 25


def test_landmarks_in_a_given_roi_need_no_detector(networks: Path, clip_frames: ClipFrames) -> None:
    (frame,) = clip_frames("akiyo.mp4", 1)
    first = LandmarkTracker(networks, BlazeFaceDetector(networks)).update(frame)
    assert first is not None
    nobody = Nobody()
    tracker = LandmarkTracker(networks, nobody)
    landmarks = np.full((468, 3), np.nan)
    landmarks[::3], landmarks[list(OUTER_EYE_CORNERS)] = (
        first.points[::3],
        first.points[list(OUTER_EYE_CORNERS)],
    )
    tracker.set_roi(roi_from_landmarks(landmarks))
    found = tracker.update(frame)
    assert found is not None and nobody.asked == 0
    assert np.abs(found.points[:, :2] - first.points[:, :2]).mean() < 1
