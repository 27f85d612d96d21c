"""Which tracker the options open, and which options are refused."""

import numpy as np
import pytest

from encoder.detection.tflite import NetworkFilesMissing
from encoder.thesis import trackers
from encoder.thesis.model_tracker import ModelTracker
from encoder.thesis.trackers import (
    TRACKED_EAUS,
    FaceTracker,
    HaarPoseTracker,
    LandmarkFitTracker,
    TrackingOptions,
    open_tracker,
)
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
    ("options", "complaint"),
    [
        (TrackingOptions(detector="guess"), "detector guess is unknown"),
        (TrackingOptions(tracker="guess"), "tracker guess is unknown"),
        (TrackingOptions(step="guess"), "step guess is unknown; choose one of gauss-newton"),
        (TrackingOptions(normalise="guess"), "normalisation guess is unknown; choose one of none"),
        (TrackingOptions(without=frozenset({"guess"})), "part guess is unknown; choose one of net"),
    ],
)
def test_an_unknown_option_is_a_user_error(
    networks: object, options: TrackingOptions, complaint: str
) -> None:
    with pytest.raises(UserError, match=complaint):
        opened(options)


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
