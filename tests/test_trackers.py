"""Which follower the options open, and what they refuse."""

import numpy as np
import pytest

from encoder.detection.tflite import NetworkFilesMissing
from encoder.tracking import trackers as follow
from encoder.tracking.model_tracker import TrackingFollower
from encoder.tracking.trackers import (
    FOLLOWED,
    Follower,
    FollowOptions,
    HaarFollower,
    NetworkFollower,
    blend,
    open_follower,
)
from shared_model.errors import UserError
from shared_model.geometry import euler_deg, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, THESIS_EAUS, FaceParameters


def opened(options: FollowOptions, warnings: list[str] | None = None) -> Follower:
    said = [] if warnings is None else warnings
    return open_follower(options, generic_head(), (320, 240), FOLLOWED, 0.04, said.append)


def test_the_whole_tracker_is_the_default(networks: object) -> None:
    assert isinstance(opened(FollowOptions()), TrackingFollower)


def test_each_frame_can_be_measured_by_itself(networks: object) -> None:
    assert isinstance(opened(FollowOptions(tracker="single")), NetworkFollower)


@pytest.mark.parametrize(
    ("tracker", "kind"), [("single", HaarFollower), ("full", TrackingFollower)]
)
def test_viola_jones_steps_in_where_the_networks_are_missing(
    monkeypatch: pytest.MonkeyPatch, tracker: str, kind: type
) -> None:
    def missing() -> None:
        raise NetworkFilesMissing("no landmark networks")

    monkeypatch.setattr(follow, "find_network_folder", missing)
    warnings: list[str] = []
    assert isinstance(opened(FollowOptions(tracker=tracker), warnings), kind)
    assert warnings == ["no landmark networks; following by Viola-Jones"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (FollowOptions(detector="guess"), "detector guess is unknown"),
        (FollowOptions(tracker="guess"), "tracker guess is unknown"),
        (FollowOptions(step="guess"), "step guess is unknown; choose one of gauss-newton"),
        (FollowOptions(normalise="guess"), "normalisation guess is unknown; choose one of none"),
        (FollowOptions(without=frozenset({"guess"})), "part guess is unknown; choose one of net"),
    ],
)
def test_an_option_that_cannot_be_is_the_users_mistake(
    networks: object, options: FollowOptions, complaint: str
) -> None:
    with pytest.raises(UserError, match=complaint):
        opened(options)


@pytest.mark.parametrize("tracker", ["single", "full"])
def test_a_picture_without_a_face_has_no_identity(networks: object, tracker: str) -> None:
    follower = opened(FollowOptions(tracker=tracker))
    assert follower.update(np.full((240, 320, 3), 128, np.uint8)) is None
    with pytest.raises(ValueError, match="no face has been seen"):
        _ = follower.fitted


def test_a_grey_picture_has_no_face_for_viola_jones() -> None:
    for tracker in ("single", "full"):
        follower = opened(FollowOptions("haar", tracker))
        assert follower.update(np.full((240, 320, 3), 128, np.uint8)) is None


def test_all_that_the_thesis_sends_is_followed() -> None:
    assert {EAU_INDEX[name] for name in THESIS_EAUS} <= set(FOLLOWED)


def test_blending_goes_half_the_way_in_angle_place_and_actuators() -> None:
    place = np.array([0.0, 0, 600])
    first = FaceParameters(pose_from_euler(0, 0, 0, place))
    second = FaceParameters(
        pose_from_euler(0, 20, 0, place + np.array([10, 0, 0])), np.full(14, 0.4)
    )
    half = blend(first, second, 0.5)
    assert euler_deg(half.pose) == pytest.approx((0, 10, 0), abs=1e-6)
    assert half.pose.translation_mm == pytest.approx([5, 0, 600])
    assert half.eau == pytest.approx(np.full(14, 0.2))
