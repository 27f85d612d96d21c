"""Whose face it is: told by looks after a gap, a cut or a jump; and cuts told from motion."""

from collections.abc import Sequence
from itertools import combinations

import pytest
from conftest import ClipFrames

from encoder.detection.landmarks import Landmarks, open_landmark_tracker
from encoder.person.face_signature import FaceSignature, SignatureMaker, are_others, is_frontal
from encoder.person.person_watch import GAP_FRAMES, PersonWatch, Verdict
from encoder.person.scene_cuts import CutDetector
from shared_model.arrays import Picture

Seen = tuple[Picture, Landmarks]
PEOPLE = ("akiyo.mp4", "carphone.mp4", "smile.mp4", "still.mpg", "turn.mp4")
FRAMES = 40


def seen(frames: Sequence[Picture]) -> list[Seen]:
    tracker = open_landmark_tracker(refine_eyelids=False)
    found = [(frame, tracker.update(frame)) for frame in frames]
    return [(frame, landmarks) for frame, landmarks in found if landmarks is not None]


@pytest.fixture(scope="module")
def people(networks: object, clip_frames: ClipFrames) -> dict[str, list[Seen]]:
    return {name: seen(clip_frames(name, FRAMES)) for name in PEOPLE}


def test_two_people_are_others_and_one_is_the_same(people: dict[str, list[Seen]]) -> None:
    for one, other in combinations(PEOPLE, 2):
        maker = SignatureMaker(people[one][0][1].points)

        def of(faces: list[Seen], maker: SignatureMaker = maker) -> list[FaceSignature]:
            return [maker.make(picture, found.points) for picture, found in faces]

        first, last = of(people[one][:20:4]), of(people[one][20::4])
        assert not are_others(first, last), one
        assert are_others(first, of(people[other][::8])), (one, other)


def verdicts(watch: PersonWatch, faces: list[Seen], is_cut: bool = False) -> list[Verdict]:
    return [
        watch.judge(picture, found.points, is_cut and not number)
        for number, (picture, found) in enumerate(faces)
    ]


@pytest.mark.parametrize("kind", ["gap", "cut"])
def test_somebody_else_is_told_within_three_faces(people: dict[str, list[Seen]], kind: str) -> None:
    watch = PersonWatch()
    assert set(verdicts(watch, people["akiyo.mp4"][:30])) == {Verdict.SAME}
    for _ in range(GAP_FRAMES if kind == "gap" else 0):
        watch.miss()
    told = verdicts(watch, people["smile.mp4"][:8], is_cut=kind == "cut")
    assert told[:3] == [Verdict.UNDECIDED, Verdict.UNDECIDED, Verdict.OTHER]
    assert set(told[3:]) == {Verdict.SAME}


def test_who_comes_back_is_the_same(people: dict[str, list[Seen]]) -> None:
    watch = PersonWatch()
    verdicts(watch, people["turn.mp4"][:20])
    for _ in range(50):
        watch.miss()
    assert Verdict.OTHER not in verdicts(watch, people["turn.mp4"][20:])


def test_a_face_in_profile_is_no_frontal_one(networks: object, clip_frames: ClipFrames) -> None:
    faces = seen(clip_frames("profile.gif", 23))
    frontal = [is_frontal(found.points) for _, found in faces]
    assert any(frontal) and not all(frontal)


def test_motion_is_no_cut_and_another_scene_is(clip_frames: ClipFrames) -> None:
    for name in ("carphone.mp4", "foreman.264", "turn.mp4"):
        cuts = CutDetector()
        assert not any(cuts.is_cut(frame) for frame in clip_frames(name, 250))
    cuts = CutDetector()
    frames = [*clip_frames("akiyo.mp4", 5), *clip_frames("smile.mp4", 5)]
    assert [cuts.is_cut(frame) for frame in frames].index(True) == 5
