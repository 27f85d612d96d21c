"""Face detectors: faces of any size and place, by BlazeFace and by Viola-Jones."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ClipFrames

from encoder.capture.video_source import open_source
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.detector import Detection, FaceDetector, by_size
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.ssd import weighted_nms
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.detection.viola_jones import HaarDetector
from shared_model.arrays import Picture
from shared_model.errors import UserError

CLIPS = Path(__file__).resolve().parents[4] / "shared" / "clips"


def first_frame(name: str) -> Picture:
    if not CLIPS.is_dir():
        pytest.skip(f"{CLIPS} is not there")
    with open_source(str(CLIPS / name)) as capture:
        return next(iter(capture))[1]


def first_picture(video: Path) -> Picture:
    with open_source(str(video)) as capture:
        return next(iter(capture))[1]


@pytest.fixture(scope="module", params=["blazeface", "haar"])
def detector(request: pytest.FixtureRequest) -> FaceDetector:
    if request.param == "haar":
        return HaarDetector()
    try:
        return BlazeFaceDetector(find_network_folder())
    except NetworkFilesMissing as missing:
        pytest.skip(str(missing))


def face(left: float, top: float, side: float, score: float = 0.9) -> Detection:
    box = np.array([left, top, left + side, top + side])
    return Detection(box, np.full((6, 2), [left, top], float), score)


def test_larger_face_comes_first() -> None:
    assert [f.size_px for f in by_size([face(0, 0, 30), face(90, 0, 50)])] == [50, 30]


def test_overlapping_detections_become_their_weighted_mean() -> None:
    (merged,) = weighted_nms([face(0, 0, 100, 0.9), face(10, 0, 100, 0.6)])
    assert merged.score == 0.9
    assert merged.box[0] == pytest.approx(10 * 0.6 / 1.5)
    assert merged.keypoints[0, 0] == pytest.approx(10 * 0.6 / 1.5)


def test_separate_detections_stay_and_nested_ones_merge() -> None:
    assert len(weighted_nms([face(0, 0, 100), face(200, 0, 100)])) == 2
    assert len(weighted_nms([face(0, 0, 100), face(20, 20, 40)])) == 1


def test_folder_without_networks_is_reported(tmp_path: Path) -> None:
    with pytest.raises(NetworkFilesMissing, match=r"face_landmark\.tflite"):
        find_network_folder(tmp_path)


def test_no_face_in_noise_and_in_flat_pictures(detector: FaceDetector) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (240, 320, 3), np.uint8)
    assert detector.detect(noise) == []
    assert detector.detect(np.full((90, 160, 3), 127, np.uint8)) == []


@pytest.mark.parametrize(
    ("name", "eyes"),
    [
        # The eyes' centres as read off the first frame by hand, pixels.
        ("akiyo.mp4", [[156, 115], [190, 113]]),
        ("carphone.mp4", [[76, 60], [98, 55]]),
        ("smile.mp4", [[258, 170], [330, 168]]),
    ],
)
def test_eyes_are_found_in_place(detector: FaceDetector, name: str, eyes: list[list[int]]) -> None:
    (found,) = detector.detect(first_frame(name))
    distance = np.linalg.norm(np.diff(np.array(eyes), axis=0))
    error = np.linalg.norm(found.keypoints[:2] - eyes, axis=1)
    assert error.max() < 0.25 * distance, found.keypoints[:2]


@pytest.mark.parametrize("corner", [(80, 150), (820, 1500)])
def test_small_face_off_centre_in_a_tall_picture_is_found(
    detector: FaceDetector, corner: tuple[int, int]
) -> None:
    picture = np.full((1920, 1080, 3), 110, np.uint8)
    small = cv2.resize(first_frame("akiyo.mp4"), None, fx=0.7, fy=0.7)
    x, y = corner
    picture[y : y + small.shape[0], x : x + small.shape[1]] = small[:, : 1080 - x]
    (found, *_) = detector.detect(picture)
    eyes = 0.7 * np.array([[156, 115], [190, 113]]) + corner
    assert np.abs(found.keypoints[:2] - eyes).max() < 10, found.keypoints[:2]


def test_a_small_face_is_found_within_some_frames_if_each_looks_at_a_part(networks: Path) -> None:
    face = cv2.resize(first_frame("smile.mp4"), None, fx=0.12, fy=0.12)
    frame = np.full((480, 640, 3), 110, np.uint8)
    frame[-face.shape[0] - 40 : -40, 60 : 60 + face.shape[1]] = face
    detector = BlazeFaceDetector(networks)
    [expected] = detector.detect(frame)
    looks = 0
    while not (found := detector.detect_part(frame)):
        looks += 1
    assert 0 < looks <= 12
    assert np.abs(found[0].box - expected.box).max() < 0.3 * expected.size_px


def test_two_faces_are_both_found(detector: FaceDetector) -> None:
    frame = first_frame("smile.mp4")
    smaller = cv2.resize(frame, None, fx=0.7, fy=0.7)
    both = np.zeros((frame.shape[0], frame.shape[1] + smaller.shape[1], 3), np.uint8)
    both[: smaller.shape[0], : smaller.shape[1]] = smaller
    both[:, smaller.shape[1] :] = frame
    large, small = detector.detect(both)
    assert large.size_px > small.size_px
    assert large.box[0] > small.box[2]


def test_rolled_head_is_found(detector: FaceDetector) -> None:
    frame = first_frame("smile.mp4")
    turn = cv2.getRotationMatrix2D((294.0, 168.0), 35, 1.0)
    rolled = cv2.warpAffine(frame, turn, (frame.shape[1], frame.shape[0]))
    (found, *_) = detector.detect(np.asarray(rolled, np.uint8))
    along = found.keypoints[1] - found.keypoints[0]
    assert np.degrees(np.arctan2(-along[1], along[0])) == pytest.approx(35, abs=12)


@pytest.mark.parametrize("share", [0.8, 0.65, 0.5])
def test_a_face_that_is_larger_than_the_picture_is_found(
    networks: Path, clip_frames: ClipFrames, share: float
) -> None:
    [frame] = clip_frames("grimace.mp4", 1)
    tracker = LandmarkTracker(networks, BlazeFaceDetector(networks))
    whole = tracker.update(frame)
    assert whole is not None
    low, high = whole.points[:, :2].min(0), whole.points[:, :2].max(0)
    (left, top), (width, height) = (low + high) / 2 - share * (high - low) / 2, share * (high - low)
    part = frame[int(top) : int(top + height), int(left) : int(left + width)]
    found = LandmarkTracker(networks, BlazeFaceDetector(networks)).update(
        np.ascontiguousarray(part)
    )
    assert found is not None
    nose_px = found.points[1, :2] + [int(left), int(top)] - whole.points[1, :2]
    assert np.abs(nose_px).max() < 0.06 * (high - low)[0]


def test_what_is_no_cascade_for_noses_is_a_user_error(tmp_path: Path) -> None:
    for content in (b"", b"<?xml version='1.0'?><none/>"):
        file = tmp_path / "nose.xml"
        file.write_bytes(content)
        with pytest.raises(UserError, match="no cascade classifier"):
            HaarDetector(file)
    with pytest.raises(UserError, match="no cascade classifier"):
        HaarDetector(tmp_path / "missing.xml")


def test_a_nose_that_is_detected_replaces_the_placed_one(carphone: Path) -> None:
    """OpenCV comes without a cascade for noses: one for eyes finds something else there."""
    picture = first_picture(carphone)
    eyes = Path(cv2.__file__).parent / "data" / "haarcascade_eye.xml"
    placed, searched = HaarDetector(), HaarDetector(eyes)
    first, second = placed.detect(picture)[0].keypoints, searched.detect(picture)[0].keypoints
    distance = np.linalg.norm(first[1] - first[0])
    assert 0.05 * distance < np.linalg.norm(second[2] - first[2]) < 1.1 * distance
    np.testing.assert_array_equal(np.delete(first, 2, 0), np.delete(second, 2, 0))
