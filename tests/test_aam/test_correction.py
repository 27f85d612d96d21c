"""Annotations corrected by hand: what is set holds, the rest is fitted, and nothing gets lost."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from aam_faces import HEAD, JAW_DROP, POSE, SIZE, known_face, landmarks_of, write_csv, write_picture

from aam.annotation.annotation_file import Annotation, read_annotation
from aam.annotation.correction import Correction, correct, correction_from, correction_values
from aam.annotation.held_values import HeldValues
from aam.annotation.landmark_schemes import FaceLandmarks, from_known, from_search
from aam.annotation.originals import read_original, save_corrected
from aam.annotation.still_fit import fit_still
from aam.shape_space import SHAPE_COUNT, SHAPE_NAMES
from risorius.cli import main
from shared_model.parameters import AAUS, THESIS_EAUS

NOSE_TIP, MOUTH_CORNER = 4, 61


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the annotation of one picture, `a.json`, and beside it the picture's folder."""
    folder = tmp_path_factory.mktemp("correction")
    write_picture(folder / "a.png")
    write_csv(folder / "points.csv", {"a.png": landmarks_of(*known_face(), POSE)})
    assert annotate(folder, "annotated") == 0
    return folder


def annotate(folder: Path, output: str, *more: str) -> int:
    """The exit code of `risorius annotate` with the landmarks of the CSV."""
    where = ("--landmarks", str(folder / "points.csv"), "-o", str(folder / output))
    return main(["annotate", str(folder / "a.png"), *where, "-q", *more])


def picture_and_annotation(folder: Path) -> tuple[np.ndarray, Annotation]:
    picture = cv2.imread(str(folder / "a.png"))
    assert picture is not None
    return picture, read_annotation(folder / "annotated" / "a.json")


@pytest.mark.parametrize("projection", ["weak", "perspective"])
def test_what_is_held_stays_and_the_rest_is_fitted(projection: str) -> None:
    landmarks = from_search(landmarks_of(*known_face(), POSE))
    free = fit_still(HEAD, SIZE, landmarks, projection)
    shape = np.full(SHAPE_COUNT, np.nan)
    shape[[0, JAW_DROP]] = 0.4, 0.1
    pose = free.pose + np.array([0, 0.3, 0, 2, 0, 0])
    values = fit_still(HEAD, SIZE, landmarks, projection, held=HeldValues(shape, None))
    np.testing.assert_allclose(values.shape[[0, JAW_DROP]], [0.4, 0.1], atol=1e-12)
    assert np.abs(values.shape - free.shape)[1:JAW_DROP].max() > 0.01
    posed = fit_still(
        HEAD, SIZE, landmarks, projection, held=HeldValues(HeldValues.none().shape, pose)
    )
    np.testing.assert_allclose(posed.pose, pose, atol=1e-9)
    assert posed.error > 2 * free.error


def test_a_landmark_draws_the_model_the_more_the_more_it_weighs(annotated: Path) -> None:
    picture, annotation = picture_and_annotation(annotated)
    x, y = annotation.landmarks[MOUTH_CORNER, :2]
    put = {MOUTH_CORNER: (x - 3.0, y + 2.0)}
    errors = [
        np.hypot(*(put[MOUTH_CORNER] - model_point(correct(annotation, picture, each))))
        for each in (
            Correction(put, weight=1),
            Correction(put, weight=8),
            Correction(put, weight=30),
        )
    ]
    assert errors[0] > 3 and errors[0] > 2 * errors[1] > 4 * errors[2]


def model_point(annotation: Annotation) -> np.ndarray:
    from aam.annotation.contact_sheet import model_landmarks
    from encoder.fitting.landmark_fit import landmark_model

    at = int(np.flatnonzero(landmark_model(HEAD).index == MOUTH_CORNER)[0])
    return np.asarray(model_landmarks(annotation)[at])


def test_a_correction_is_written_read_and_taken_back(annotated: Path) -> None:
    picture, original = picture_and_annotation(annotated)
    folder = annotated / "annotated"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    place = original.landmarks[NOSE_TIP, 0] + 3.0, original.landmarks[NOSE_TIP, 1]
    correction = Correction({NOSE_TIP: place}, {"jaw_drop": 0.8}, tuple(original.pose), 12.0)
    save_corrected(folder, original, correct(original, picture, correction))
    stored = read_annotation(folder / "a.json")
    assert correction_from(stored.correction, SIZE) == correction
    np.testing.assert_allclose(stored.landmarks[NOSE_TIP, :2], place, atol=1e-4)
    assert stored.shape[SHAPE_NAMES.index("jaw_drop")] == pytest.approx(0.8)
    assert (stored.texture != original.texture).any()
    kept = read_original(folder, "a")
    assert not kept.correction
    np.testing.assert_array_equal(kept.shape, original.shape)
    # A second correction starts from the fit without a hand, not from the first.
    save_corrected(folder, kept, correct(kept, picture, Correction({}, {"jaw_drop": 0.2})))
    np.testing.assert_array_equal(read_original(folder, "a").landmarks, original.landmarks)
    save_corrected(folder, kept, correct(kept, picture, Correction()))
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert after == before


def test_annotating_again_keeps_what_a_hand_has_set(annotated: Path) -> None:
    picture, original = picture_and_annotation(annotated)
    folder = annotated / "again"
    assert annotate(annotated, "again") == 0
    corrected = correct(original, picture, Correction({}, {"jaw_drop": 0.8}))
    save_corrected(folder, original, corrected)
    written = (folder / "a.json").read_bytes()
    assert annotate(annotated, "again") == 0
    assert (folder / "a.json").read_bytes() == written
    assert annotate(annotated, "again", "--perspective") == 0
    stored, kept = read_annotation(folder / "a.json"), read_original(folder, "a")
    assert stored.projection == kept.projection == "perspective"
    assert stored.shape[JAW_DROP] == pytest.approx(0.8) and kept.shape[JAW_DROP] < 0.7


@pytest.mark.parametrize(
    "values",
    [
        {"landmarks": {"468": [1, 2]}},
        {"landmarks": {"nose": [1, 2]}},
        {"landmarks": {"4": [1, float("nan")]}},
        {"landmarks": {"4": [1, 1e6]}},
        {"landmarks": {"4": [1, 2, 3]}},
        {"landmarks": [4]},
        {"landmarks": None},
        {"shape": {"grin": 1}},
        {"shape": {"jaw_drop": 1.5}},
        {"shape": {"jaw_drop": "wide"}},
        {"shape": {"jaw_drop": None}},
        {"pose": [0, 0, 0]},
        {"pose": [0, 0, 0, 1, 1, float("inf")]},
        {"pose": 7},
        {"weight": 0},
        {"weight": []},
    ],
)
def test_what_is_no_correction_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        correction_from(values, SIZE)


def test_a_correction_survives_json() -> None:
    correction = Correction({4: (1.5, 2.25)}, {"lid_left": 0.5}, (0.1, 0, 0, 5, 6, 0.2), 3.0)
    text = json.dumps(correction_values(correction))
    assert correction_from(json.loads(text), SIZE) == correction
    assert correction_values(Correction(weight=3.0)) == {}
    assert correction_from({}, SIZE).is_empty


def test_the_outline_of_few_landmarks_is_less_sure_as_when_they_were_given() -> None:
    from aam.annotation.landmark_schemes import IBUG_68, from_given

    points = landmarks_of(*known_face(), POSE)[list(IBUG_68), :2]
    given = from_given(points)
    known: FaceLandmarks = from_known(given.points)
    np.testing.assert_array_equal(known.sigma, given.sigma)
    assert (from_known(landmarks_of(*known_face(), POSE)).sigma == 1).all()


def test_annotations_for_tracking_move_the_actuators_of_the_thesis_alone(annotated: Path) -> None:
    assert annotate(annotated, "tracking", "--eaus", "thesis") == 0
    picture, _ = picture_and_annotation(annotated)
    found = read_annotation(annotated / "tracking" / "a.json")
    corrected = correct(found, picture, Correction({NOSE_TIP: (90.0, 80.0)}))
    moved = [SHAPE_NAMES.index(name) for name in THESIS_EAUS]
    for annotation in (found, corrected):
        eau = annotation.shape[len(AAUS) :]
        others = np.delete(eau, np.array(moved) - len(AAUS))
        assert np.abs(annotation.shape[moved]).max() > 0.05 and not others.any()
