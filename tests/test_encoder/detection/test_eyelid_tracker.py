"""The iris network sees one eye after the other, and both as soon as one of them moves."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from encoder.detection.eyelid_tracker import EyelidTracker
from encoder.detection.iris import INPUT_PX, EyeView, IrisLandmarker
from encoder.detection.landmark_indices import EYE_CORNER_PAIRS, LANDMARK_COUNT

Array = NDArray[np.float64]
OPEN, CLOSED = 0.3, 0.02
# In the network's contour: the outer and inner corner, a lower and an upper lid.
OUTER, INNER, LOWER, UPPER = 0, 8, slice(1, 8), slice(9, 16)
LOWER_LIDS, UPPER_LIDS = (145, 374), (159, 386)
FRAME = np.zeros((8, 8, 3), np.uint8)


class DrawnEyes(IrisLandmarker):
    """Sees eyes that are drawn as far open as a test says.

    apertures: of the right and the left eye, in widths of the eye.  seen: which of them the network
    was run on since this was cleared.
    """

    def __init__(self) -> None:
        self.apertures = [OPEN, OPEN]
        self.seen = list[int]()

    def views(self, frame: NDArray[np.uint8], points: Array) -> tuple[EyeView, EyeView]:
        first, second = (self._view(points, side) for side in range(2))
        return first, second

    def contour(self, view: EyeView) -> Array:
        side = int(view.pixel_from_crop[0, 2] > 150)
        self.seen.append(side)
        contour = np.zeros((71, 2))
        contour[OUTER], contour[INNER] = (8, 32), (56, 32)
        half = 24 * self.apertures[side]
        contour[LOWER], contour[UPPER] = (32, 32 + half), (32, 32 - half)
        return contour

    def _view(self, points: Array, side: int) -> EyeView:
        rows, columns = np.indices((INPUT_PX, INPUT_PX))
        crop = np.full((INPUT_PX, INPUT_PX, 3), 150, np.uint8)
        inside = (np.abs(rows - 32) < 24 * self.apertures[side]) & (np.abs(columns - 32) < 24)
        crop[inside] = 40
        corner = points[EYE_CORNER_PAIRS[side][0], :2]
        return EyeView(crop, np.array([[1.0, 0, corner[0]], [0, 1, corner[1]]]))


def landmarks(shift: float = 0.0) -> Array:
    points = np.zeros((LANDMARK_COUNT, 3))
    points[EYE_CORNER_PAIRS[0][0], :2] = 50 + shift, 80
    points[EYE_CORNER_PAIRS[1][0], :2] = 200 + shift, 80
    return points


def lids_of(points: Array) -> list[float]:
    """The aperture of each eye, pixels."""
    return [
        float(points[lower, 1] - points[upper, 1])
        for lower, upper in zip(LOWER_LIDS, UPPER_LIDS, strict=True)
    ]


@pytest.fixture
def eyes() -> DrawnEyes:
    return DrawnEyes()


def tracker_at_rest(eyes: DrawnEyes) -> EyelidTracker:
    tracker = EyelidTracker(eyes, alternates=True)
    tracker.replace_eyelids(FRAME, landmarks())
    eyes.seen.clear()
    return tracker


def test_eyes_at_rest_are_seen_in_turn(eyes: DrawnEyes) -> None:
    tracker = tracker_at_rest(eyes)
    for _ in range(6):
        tracker.replace_eyelids(FRAME, landmarks())
    assert len(eyes.seen) == 6
    assert all(a != b for a, b in zip(eyes.seen[::2], eyes.seen[1::2], strict=True))


@pytest.mark.parametrize("closing", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("frames_before", [1, 2])
def test_a_blink_or_wink_is_seen_in_its_frame(
    eyes: DrawnEyes, closing: tuple[int, ...], frames_before: int
) -> None:
    tracker = tracker_at_rest(eyes)
    for _ in range(frames_before):
        tracker.replace_eyelids(FRAME, landmarks())
    for side in closing:
        eyes.apertures[side] = CLOSED
    found = lids_of(tracker.replace_eyelids(FRAME, landmarks()))
    assert found == pytest.approx([48 * aperture for aperture in eyes.apertures])
    for side in closing:
        eyes.apertures[side] = OPEN
    found = lids_of(tracker.replace_eyelids(FRAME, landmarks()))
    assert found == pytest.approx([48 * OPEN] * 2)


def test_lids_that_look_the_same_are_still_seen_if_the_other_eye_opens(eyes: DrawnEyes) -> None:
    tracker = tracker_at_rest(eyes)
    eyes.apertures = [OPEN + 0.03, OPEN + 0.03]
    tracker.replace_eyelids(FRAME, landmarks())
    assert set(eyes.seen) == {0, 1}


def test_an_eye_that_rests_opens_with_the_other(eyes: DrawnEyes) -> None:
    tracker = tracker_at_rest(eyes)
    eyes.apertures = [OPEN + 0.01, OPEN + 0.01]
    found = lids_of(tracker.replace_eyelids(FRAME, landmarks()))
    assert len(eyes.seen) == 1
    assert found == pytest.approx([48 * (OPEN + 0.01)] * 2)


def test_an_eye_that_rests_moves_with_the_head(eyes: DrawnEyes) -> None:
    tracker = tracker_at_rest(eyes)
    before = tracker.replace_eyelids(FRAME, landmarks())
    after = tracker.replace_eyelids(FRAME, landmarks(shift=7))
    assert len(eyes.seen) == 2
    lids = [*LOWER_LIDS, *UPPER_LIDS]
    assert after[lids, 0] - before[lids, 0] == pytest.approx(7)


def test_after_another_face_both_eyes_are_seen(eyes: DrawnEyes) -> None:
    tracker = tracker_at_rest(eyes)
    tracker.reset()
    tracker.replace_eyelids(FRAME, landmarks())
    assert sorted(eyes.seen) == [0, 1]


def test_without_turns_every_frame_has_what_the_network_finds(networks: Path) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(100, 140, (LANDMARK_COUNT, 3))
    points[list(EYE_CORNER_PAIRS[0]), :2] = (70, 100), (110, 104)
    points[list(EYE_CORNER_PAIRS[1]), :2] = (190, 100), (150, 104)
    landmarker = IrisLandmarker(networks)
    tracker = EyelidTracker(landmarker, alternates=False)
    for _ in range(3):
        frame = rng.integers(0, 255, (200, 260, 3), np.uint8)
        found = tracker.replace_eyelids(frame, points)
        assert np.array_equal(found, landmarker.replace_eyelids(frame, points))
