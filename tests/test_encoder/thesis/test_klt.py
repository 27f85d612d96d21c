"""KLT and visibility: motion is tracked precisely, hidden and lost points are rejected."""

import cv2
import numpy as np
import pytest

from encoder.thesis.klt import KltTracker
from encoder.thesis.vertex_visibility import VertexVisibility
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.normals import vertex_normals
from shared_model.parameters import AAUS, FaceParameters

HEAD = generic_head()
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))
# So far away that moving the head moves its picture by a similarity, which a warp makes exactly.
FAR = Camera(400, 300, 60_000.0)
CENTRE = (np.array([FAR.width, FAR.height]) - 1) / 2


def face_at(roll_deg: float, shift_px: tuple[float, float], scale: float = 1.0) -> FaceParameters:
    depth = 40_000.0 / scale
    x, y = np.array(shift_px) * depth / FAR.focal_px
    return FaceParameters(pose_from_euler(0, 0, roll_deg, np.array([x, y, depth])))


def skin(rng: np.random.Generator) -> np.ndarray:
    noise = cv2.GaussianBlur(rng.normal(0, 1, (FAR.height, FAR.width)), (0, 0), 2.5)
    grey = np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))


def moved(picture: np.ndarray, face: FaceParameters, like: FaceParameters) -> np.ndarray:
    """A picture of `like`, warped to show `face`."""
    source, target = (
        pixel_from_head(FAR, f.pose, HEAD.vertices[[0, 500, 1000]]).astype(np.float32)
        for f in (like, face)
    )
    affine = cv2.getAffineTransform(source, target)
    size = (FAR.width, FAR.height)
    return cv2.warpAffine(
        picture, affine, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


@pytest.fixture(scope="module")
def start() -> tuple[np.ndarray, FaceParameters]:
    return skin(np.random.default_rng(11)), face_at(0, (0, 0))


def test_features_are_spaced_apart_in_muscle_free_visible_skin(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    tracker = KltTracker(FACE, start[0], FAR, start[1])
    fields = np.linalg.norm(np.concatenate([HEAD.eau_up, HEAD.eau_down]), axis=2).max(axis=0)
    assert len(tracker.index) >= 20
    assert np.median(fields[tracker.index]) < 1.5
    assert (HEAD.parts[tracker.index] == 0).all()
    pixels = pixel_from_head(FAR, start[1].pose, HEAD.vertices[tracker.index])
    gaps = np.linalg.norm(pixels[:, None] - pixels[None], axis=2) + 1e9 * np.eye(len(pixels))
    assert gaps.min() > 10


@pytest.mark.parametrize(
    ("roll", "shift", "scale"),
    [(0, (3.3, -1.7), 1.0), (4, (0, 0), 1.0), (0, (0, 0), 1.03), (-3, (-5.5, 4.2), 0.98)],
)
def test_unpredicted_motion_is_tracked_to_a_fifth_of_a_pixel(
    start: tuple[np.ndarray, FaceParameters],
    roll: float,
    shift: tuple[float, float],
    scale: float,
) -> None:
    picture, still = start
    tracker = KltTracker(FACE, picture, FAR, still)
    truth = face_at(roll, shift, scale)
    tracks = tracker.track(moved(picture, truth, still), FAR, still)
    expected = pixel_from_head(FAR, truth.pose, HEAD.vertices[tracker.index])
    found = np.isfinite(tracks.variance_px2)
    assert tracks.inlier_share > 0.9
    assert np.linalg.norm(tracks.pixels - expected, axis=1)[found].mean() < 0.2


def test_reprojected_points_do_not_drift_over_many_frames(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    picture, still = start
    tracker = KltTracker(FACE, picture, FAR, still)
    before = still
    for step in range(1, 30):
        truth = face_at(8 * np.sin(step / 5), (10 * np.sin(step / 7), 6 * np.cos(step / 7) - 6))
        frame = moved(picture, truth, still)
        tracks = tracker.track(frame, FAR, before)
        tracker.reset_points(frame, FAR, truth)
        before = truth
    expected = pixel_from_head(FAR, truth.pose, HEAD.vertices[tracker.index])
    found = np.isfinite(tracks.variance_px2)
    assert np.linalg.norm(tracks.pixels - expected, axis=1)[found].mean() < 0.1


def test_occluded_points_are_rejected(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    picture, still = start
    tracker = KltTracker(FACE, picture, FAR, still)
    covered = picture.copy()
    covered[:, :200] = skin(np.random.default_rng(12))[:, :200]
    tracks = tracker.track(covered, FAR, still)
    behind = pixel_from_head(FAR, still.pose, HEAD.vertices[tracker.index])[:, 0] < 180
    found = np.isfinite(tracks.variance_px2)
    assert found[behind].mean() < 0.3
    assert found[~behind].mean() > 0.7
    assert tracks.inlier_share < 0.8


def test_a_face_outside_the_picture_has_no_tracks(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    tracker = KltTracker(FACE, start[0], FAR, start[1])
    tracks = tracker.track(start[0], FAR, face_at(0, (900, 0)))
    assert not np.isfinite(tracks.variance_px2).any()
    assert tracks.inlier_share == 0


def test_normals_point_outwards() -> None:
    normals = vertex_normals(HEAD.vertices, HEAD.triangles)
    marks = HEAD.landmarks
    assert normals[marks["prn"], 2] > 0.7
    assert normals[marks["zy_l"], 0] > 0.5 > -0.5 > normals[marks["zy_r"], 0]


def test_the_far_side_of_the_face_is_hidden_when_the_head_turns() -> None:
    marks = [HEAD.landmarks[name] for name in ("zy_l", "zy_r", "en_l", "en_r", "prn")]
    visibility = VertexVisibility(HEAD.vertices, HEAD.triangles, np.array(marks, np.int32))
    place = np.array([0.0, 0, 700])
    ahead = visibility.visible(pose_from_euler(0, 0, 0, place))
    left = visibility.visible(pose_from_euler(0, 50, 0, place))
    assert ahead[2:].all()
    # The subject turns to the left: the camera sees the right cheek, the nose hides the left eye.
    assert list(left[:4]) == [False, True, False, True]


def test_points_move_to_another_shape_with_set_face(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    picture, face = start
    tracker = KltTracker(FACE, picture, FAR, face)
    wider = Face(HEAD, Identity(np.full(len(AAUS), 0.5), np.zeros_like(HEAD.vertices)))
    tracker.set_face(wider)
    tracker.reset_points(picture, FAR, face)
    tracks = tracker.track(picture, FAR, face)
    np.testing.assert_allclose(tracks.points_mm, wider.neutral[tracker.index])
    assert np.abs(tracks.points_mm - FACE.neutral[tracker.index]).max() > 0.5


def turned(yaw_deg: float) -> FaceParameters:
    return FaceParameters(pose_from_euler(0, yaw_deg, 0, np.array([0.0, 0.0, 40_000.0])))


def test_hidden_points_give_way_to_others_where_that_is_asked(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    fixed = KltTracker(FACE, start[0], FAR, start[1])
    tracker = KltTracker(FACE, start[0], FAR, start[1], replace_hidden=True)
    first = tracker.index.copy()
    np.testing.assert_array_equal(first, fixed.index)
    for each in (fixed, tracker):
        each.reset_points(start[0], FAR, turned(60))
    np.testing.assert_array_equal(first, fixed.index)
    assert len(tracker.index) == len(first) and len(set(tracker.index)) == len(first)
    shown = [
        VertexVisibility(HEAD.vertices, HEAD.triangles, each.index).visible(turned(60).pose)
        for each in (fixed, tracker)
    ]
    assert shown[1].sum() > shown[0].sum() + 3
    # Those that are still seen stay in their places.
    np.testing.assert_array_equal(tracker.index[shown[0]], first[shown[0]])
    tracks = tracker.track(start[0], FAR, turned(60))
    assert np.isfinite(tracks.variance_px2).sum() > 0.8 * shown[1].sum()


def test_a_head_that_has_not_turned_keeps_its_points(
    start: tuple[np.ndarray, FaceParameters],
) -> None:
    tracker = KltTracker(FACE, start[0], FAR, start[1], replace_hidden=True)
    first = tracker.index.copy()
    tracker.reset_points(start[0], FAR, turned(5))
    np.testing.assert_array_equal(first, tracker.index)
