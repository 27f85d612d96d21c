"""Drawn faces: where their landmarks are, what differs between people; without the wheel."""

import numpy as np
import pytest

from assets.drawn_faces.identities import amounts, by_detail
from assets.drawn_faces.paint import draw_skin
from assets.drawn_faces.picture import SIZE, DrawnFace, studio
from encoder.detection.landmark_indices import EYELID_MARGINS
from encoder.detection.landmarks import open_landmark_tracker
from encoder.detection.viola_jones import HaarDetector
from shared_model.mesh import generic_head


def drawn(number: int) -> DrawnFace:
    random = np.random.default_rng(number)
    shape = np.zeros_like(generic_head().vertices)
    return studio().photograph(random, shape, draw_skin(random))


@pytest.fixture(scope="module")
def faces() -> list[DrawnFace]:
    return [drawn(number) for number in range(6)]


def test_the_same_number_gives_the_same_picture(faces: list[DrawnFace]) -> None:
    again = drawn(3)
    np.testing.assert_array_equal(again.picture, faces[3].picture)
    np.testing.assert_array_equal(again.landmarks, faces[3].landmarks)
    assert (faces[3].picture != faces[4].picture).any()


def test_landmarks_are_in_the_picture_and_upright(faces: list[DrawnFace]) -> None:
    for face in faces:
        assert face.picture.shape == (SIZE, SIZE, 3) and face.picture.dtype == np.uint8
        inside = (face.landmarks > -0.1 * SIZE) & (face.landmarks < 1.1 * SIZE)
        assert inside.all()
        eyes, chin = face.landmarks[list(sum(EYELID_MARGINS, ()))], face.landmarks[152]
        assert chin[1] > eyes[:, 1].max() + 0.1 * SIZE


def test_detectors_take_drawn_faces_for_faces(faces: list[DrawnFace], networks: object) -> None:
    detector = HaarDetector()
    assert sum(bool(detector.detect(face.picture)) for face in faces) >= 4
    off = []
    for face in faces:
        found = open_landmark_tracker().update(face.picture)
        if found is not None:
            eyes = np.linalg.norm(face.landmarks[33] - face.landmarks[263])
            off.append(np.linalg.norm(found.points[:, :2] - face.landmarks, axis=1).mean() / eyes)
    assert len(off) >= 4 and np.median(off) < 0.08


def test_opposite_targets_are_one_detail() -> None:
    field = np.zeros((2, 3))
    names = ["nose-width-incr", "nose-width-decr", "head-oval", "african-male-old", "mouthClose"]
    details = by_detail({name: field + number for number, name in enumerate(names)})
    assert {name: sorted(ends) for name, ends in details.items()} == {
        "nose-width": [-1, 1],
        "head-oval": [1],
    }


@pytest.mark.parametrize("value", [0.0, 0.2, 0.5, 0.8, 1.0])
def testamounts_are_shares(value: float) -> None:
    shares = amounts(value)
    assert sum(shares.values()) == pytest.approx(1) and min(shares.values()) >= 0
    assert shares["max"] - shares["min"] == pytest.approx(2 * value - 1)
