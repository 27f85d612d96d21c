"""Which tracker the options open, and which options are refused."""

from typing import Any

import numpy as np
import pytest

from encoder.detection.landmarks import Landmarks
from encoder.detection.tflite import NetworkFilesMissing
from encoder.fitting.identity import generic_identity
from encoder.fitting.landmark_fit import landmark_model
from encoder.fitting.landmark_source import ExpectedFace
from encoder.thesis import trackers
from encoder.thesis.model_tracker import ModelTracker
from encoder.thesis.trackers import (
    TRACKED_EAUS,
    FaceTracker,
    HaarPoseTracker,
    LandmarkFitTracker,
    open_tracker,
)
from encoder.thesis.tracking_options import TrackingOptions
from shared_model.arrays import Picture
from shared_model.errors import UserError
from shared_model.geometry import euler_deg, interpolate, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, THESIS_EAUS, FaceParameters


def opened(options: TrackingOptions, warnings: list[str] | None = None) -> FaceTracker:
    said = [] if warnings is None else warnings
    return open_tracker(options, generic_head(), (320, 240), TRACKED_EAUS, 0.04, said.append)


def test_the_full_tracker_is_the_default(networks: object) -> None:
    assert isinstance(opened(TrackingOptions()), ModelTracker)


def test_each_frame_can_be_measured_by_itself(networks: object) -> None:
    assert isinstance(opened(TrackingOptions(tracker="single")), LandmarkFitTracker)


@pytest.mark.parametrize(("tracker", "kind"), [("single", HaarPoseTracker), ("full", ModelTracker)])
def test_viola_jones_replaces_missing_networks(
    monkeypatch: pytest.MonkeyPatch, tracker: str, kind: type
) -> None:
    def missing() -> None:
        raise NetworkFilesMissing("no landmark networks")

    monkeypatch.setattr(trackers, "find_network_folder", missing)
    warnings: list[str] = []
    assert isinstance(opened(TrackingOptions(tracker=tracker), warnings), kind)
    assert warnings == ["no landmark networks; tracking with Viola-Jones' detector"]


@pytest.mark.parametrize(
    ("choice", "complaint"),
    [
        ({"detector": "guess"}, "detector guess is unknown"),
        ({"tracker": "guess"}, "tracker guess is unknown"),
        ({"step": "guess"}, "step guess is unknown; choose one of gauss-newton"),
        ({"normalise": "guess"}, "normalisation guess is unknown; choose one of none"),
        ({"without": frozenset({"guess"})}, "part guess is unknown; choose one of net"),
    ],
)
def test_an_unknown_choice_is_a_user_error(choice: dict[str, Any], complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        TrackingOptions(**choice)


@pytest.mark.parametrize("kind", ["single", "full"])
def test_a_picture_without_a_face_has_no_identity(networks: object, kind: str) -> None:
    tracker = opened(TrackingOptions(tracker=kind))
    assert tracker.update(np.full((240, 320, 3), 128, np.uint8)) is None
    with pytest.raises(ValueError, match="no face has been seen"):
        _ = tracker.fitted


def test_a_grey_picture_has_no_face_for_viola_jones() -> None:
    for kind in ("single", "full"):
        tracker = opened(TrackingOptions("haar", kind))
        assert tracker.update(np.full((240, 320, 3), 128, np.uint8)) is None


class WideFace:
    """A `LandmarkSource` that shows a head whose landmarks are a tenth further apart in x."""

    face_count, sigma_ratio, every_frame = 1, 2.0, True

    def __init__(self) -> None:
        self.expected: list[ExpectedFace | None] = []

    def expect(self, face: ExpectedFace | None) -> None:
        self.expected.append(face)

    def update(self, frame: Picture, next_frame: Picture | None = None) -> Landmarks | None:
        model = landmark_model(generic_head())
        points = np.full((468, 3), np.nan)
        points[model.index] = model.neutral * [0.66, -0.6, -0.6] + [160, 120, 0]
        return Landmarks(points, 0.8)


@pytest.mark.parametrize("kind", ["single", "full"])
def test_landmarks_of_another_source_give_the_person_a_head_of_its_own(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    def missing() -> None:
        raise NetworkFilesMissing("no landmark networks")

    monkeypatch.setattr(trackers, "find_network_folder", missing)
    source, warnings = WideFace(), list[str]()
    tracker = opened(TrackingOptions(tracker=kind, landmarks=source), warnings)
    noise = np.random.default_rng(1).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    assert tracker.update(noise) is not None
    generic = generic_identity(generic_head(), (320, 240))
    assert np.abs(tracker.fitted.identity.aau - generic.identity.aau).max() > 0.1
    assert tracker.update(noise) is not None
    assert not warnings
    if kind == "full":
        assert [face is not None for face in source.expected] == [True]


def test_all_actuators_of_the_thesis_are_tracked() -> None:
    assert {EAU_INDEX[name] for name in THESIS_EAUS} <= set(TRACKED_EAUS)


def test_interpolation_covers_rotation_translation_and_actuators() -> None:
    place = np.array([0.0, 0, 600])
    first = FaceParameters(pose_from_euler(0, 0, 0, place))
    second = FaceParameters(
        pose_from_euler(0, 20, 0, place + np.array([10, 0, 0])), np.full(14, 0.4)
    )
    half = interpolate(first, second, 0.5)
    assert euler_deg(half.pose) == pytest.approx((0, 10, 0), abs=1e-6)
    assert half.pose.translation_mm == pytest.approx([5, 0, 600])
    assert half.eau == pytest.approx(np.full(14, 0.2))
