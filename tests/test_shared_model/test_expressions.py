"""Emotions are signed as Table 2.3 says, and no setting breaks the face."""

import numpy as np
import pytest
from model_checks import Checks, find_checks

from shared_model.anatomy.expressions import EMOTIONS, Emotion, signature
from shared_model.animate import Face, Identity
from shared_model.arrays import Array
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_HIGH, EAU_INDEX, EAU_LOW, EAUS, THESIS_EAUS, Eau

HEAD = generic_head()
# Stated tolerances.  The lower lip may slide up behind the upper one (mentalis) but never come out
# before it, and no other actuator lets lips overlap by more than OVERLAP_MM (0.2 mm at rest).
# Then: lid under brow, tooth before lip, share of the face's area turned over (canthi left out:
# their folds are smaller than a pixel).
OVERLAP_MM, OUT_MM, LID_MM, TOOTH_MM, FLIPPED = 0.6, 0.0, 1.0, 1.0, 0.005
# Antagonists that pull at once may go beyond these in two settings of a hundred, up to the worst.
RARE, WORST_OUT_MM, WORST_TOOTH_MM, WORST_FLIPPED = 0.02, 1.0, 3.0, 0.01


@pytest.fixture(scope="module")
def checks() -> Checks:
    return find_checks(HEAD)


def face(aau: Array) -> Face:
    return Face(HEAD, Identity(aau, np.zeros_like(HEAD.vertices)))


def check_always(checks: Checks, vertices: Array, eau: Array) -> None:
    if eau[EAU_INDEX["lower_lip_lower"]] >= 0:
        assert checks.lip_overlap_mm(vertices) < OVERLAP_MM
    assert checks.lid_below_brow_mm(vertices) > LID_MM
    assert checks.lower_lip_out_mm(vertices) < WORST_OUT_MM
    assert checks.teeth_through_skin_mm(vertices) < WORST_TOOTH_MM
    assert checks.flipped_share(vertices) < WORST_FLIPPED


def is_clean(checks: Checks, vertices: Array) -> bool:
    return (
        checks.lower_lip_out_mm(vertices) < OUT_MM
        and checks.teeth_through_skin_mm(vertices) < TOOTH_MM
        and checks.flipped_share(vertices) < FLIPPED
    )


def test_there_are_six_emotions_within_the_ranges_of_the_actuators() -> None:
    assert [e.name for e in EMOTIONS] == [
        "happiness",
        "anger",
        "surprise",
        "sadness",
        "fear",
        "disgust",
    ]
    for emotion in EMOTIONS:
        for name, (low, high) in emotion.ranges.items():
            eau = EAUS[EAU_INDEX[name]]
            assert eau.low <= low <= 0 <= high <= eau.high and low < high


@pytest.mark.parametrize("emotion", EMOTIONS, ids=lambda e: e.name)
def test_an_emotion_at_its_peak_is_recognised_by_its_signature(emotion: Emotion) -> None:
    found = signature(emotion.peak())
    assert max(found, key=lambda name: found[name]) == emotion.name
    assert found[emotion.name] == pytest.approx(1)


def test_a_face_at_rest_signs_no_emotion() -> None:
    noise = np.random.default_rng(5).normal(0, 0.05, (50, len(EAUS)))
    for eau in (np.zeros(len(EAUS)), noise):
        assert not any(np.any(each) for each in signature(eau).values())


@pytest.mark.parametrize("emotion", EMOTIONS, ids=lambda e: e.name)
def test_a_signature_is_of_the_kind_and_not_of_the_strength_or_a_blink(emotion: Emotion) -> None:
    eau = np.stack([0.5 * emotion.peak(), emotion.peak()])
    eau[1, [EAU_INDEX["lid_left"], EAU_INDEX["lid_right"]]] = 1.0
    assert signature(eau)[emotion.name] == pytest.approx([1, 1])


def test_the_thesis_actuators_come_with_every_emotion() -> None:
    used = {name for emotion in EMOTIONS for name in emotion.ranges}
    assert set(THESIS_EAUS) <= used


def test_no_random_setting_breaks_the_face(checks: Checks) -> None:
    rng, broken, draws = np.random.default_rng(99), 0, 150
    for _ in range(draws):
        eau = rng.uniform(EAU_LOW, EAU_HIGH) * (rng.random(len(EAUS)) < rng.choice([0.3, 1]))
        vertices = face(rng.uniform(-1, 1, len(AAUS))).animate(eau)
        check_always(checks, vertices, eau)
        broken += not is_clean(checks, vertices)
    assert broken <= RARE * draws


@pytest.mark.parametrize("emotion", EMOTIONS, ids=lambda e: e.name)
def test_no_emotion_breaks_the_face(checks: Checks, emotion: Emotion) -> None:
    vertices = face(np.zeros(len(AAUS))).animate(emotion.peak())
    check_always(checks, vertices, emotion.peak())
    assert is_clean(checks, vertices)


@pytest.mark.parametrize("eau", EAUS, ids=lambda e: e.name)
def test_no_actuator_breaks_the_face_at_either_end(checks: Checks, eau: Eau) -> None:
    for value in (eau.low, eau.high):
        drive = np.zeros(len(EAUS))
        drive[EAU_INDEX[eau.name]] = value
        vertices = face(np.zeros(len(AAUS))).animate(drive)
        check_always(checks, vertices, drive)
        assert is_clean(checks, vertices)
