"""Validation: the 2D AAM, drawn expressions, measures, tables; small models of synthetic faces."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from aam_faces import synthetic_faces

from aam.search.search import METHODS, SearchOptions
from aam.shape_space import SHAPE_COUNT
from aam.texture_frame import texture_frame
from aam.training.train import TrainingOptions
from aam.warps import head_warp
from benchmarks.validate_aam import tables
from benchmarks.validate_aam.asked import Asked, asked_rows, asked_table, verdict
from benchmarks.validate_aam.contenders import (
    NOSE_LINE,
    Contender,
    errors,
    start_pose,
    train_head,
    train_planar,
    train_residual_head,
)
from benchmarks.validate_aam.experiments import (
    PARTS,
    folds,
    run_experiments,
    training_part,
)
from benchmarks.validate_aam.first_frames import (
    FirstFrames,
    TruePicture,
    common_shift,
    judged_frames,
    landmark_offsets,
)
from benchmarks.validate_aam.model_parts import model_part, prediction_part
from benchmarks.validate_aam.planar_warp import (
    MIRRORED,
    PLANAR_LANDMARKS,
    PlanarWarp,
    mean_shape,
    mirrored_planar,
    planar_face,
    similarity,
)
from benchmarks.validate_aam.prediction_experiments import PredictionCurve
from benchmarks.validate_aam.residual_shape import mirrored_controls
from benchmarks.validate_aam.samples import Sample, split_people
from benchmarks.validate_aam.search_experiments import (
    Generalisation,
    best_possible,
    convergence,
    generalisation,
)
from benchmarks.validate_aam.search_parts import search_part, speed_part
from benchmarks.validate_aam.units.action_units import (
    ShownFaces,
    own_neutrals,
    recognise,
    show_faces,
)
from benchmarks.validate_aam.units.expressed_faces import EXPRESSIONS, with_units
from benchmarks.validate_aam.units.outcomes import found_units, judged_units
from encoder.detection.landmark_indices import OUTER_EYE_CORNERS
from risorius.track_bench.unit_scores import area_under_curve
from shared_model.arrays import Array

OPTIONS = TrainingOptions(size=64, normalisation="none", mirror=False, cascade=False)


def samples(people: int, first: int = 0) -> list[Sample]:
    """Synthetic faces with the landmarks of the head."""
    warp, found = head_warp(64, "full"), []
    for face in synthetic_faces(first + people, 1)[first:]:
        landmarks = np.full((468, 2), np.nan)
        landmarks[warp.landmark_index] = warp.landmarks(face.shape, face.pose)
        found.append(Sample(face, landmarks))
    return found


TRAIN, TEST = samples(10), samples(4, 10)


@pytest.fixture(scope="module")
def pair() -> dict[str, Contender]:
    return {"head": train_head(TRAIN, OPTIONS), "2D": train_planar(TRAIN, OPTIONS)}


def planar_landmarks(sample: Sample) -> Array:
    return sample.landmarks[list(PLANAR_LANDMARKS)]


def test_the_similarity_of_points_that_were_moved_by_one_is_that_one() -> None:
    points = planar_landmarks(TRAIN[0])
    turned = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    found = similarity(points, 1.7 * points @ turned.T + [5, -3])
    np.testing.assert_allclose(found, [0.3, 5, -3, np.log(1.7)], atol=1e-9)


def test_planar_shape_and_pose_give_back_the_landmarks() -> None:
    mean = mean_shape([planar_landmarks(each) for each in TRAIN])
    warp = PlanarWarp(32, mean)
    for sample in TRAIN:
        face = planar_face(sample.face, planar_landmarks(sample), mean)
        found = warp.landmarks(face.shape, face.pose)
        np.testing.assert_allclose(found, planar_landmarks(sample), atol=1e-9)


def test_planar_texels_lie_where_the_triangles_put_them() -> None:
    mean = mean_shape([planar_landmarks(each) for each in TRAIN])
    warp = PlanarWarp(32, mean)
    places = warp.positions(mean.ravel(), warp.upright(0.0, np.zeros(3)))
    # Of the mean shape they form a regular grid.
    same_row = warp.rows == warp.rows[len(warp.rows) // 2]
    assert np.ptp(places[1, same_row]) < 1e-3
    steps = np.diff(places[0, same_row]) / np.diff(warp.columns[same_row])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)
    assert len(warp.rows) == pytest.approx(len(head_warp(32, "full").rows), rel=0.1)


def test_planar_steps_lead_from_pose_to_pose() -> None:
    warp = PlanarWarp(32, mean_shape([planar_landmarks(each) for each in TRAIN]))
    pose, target = np.array([0.2, 10, 20, 0.5]), np.array([-0.1, 14, 17, 0.3])
    found = warp.displaced(pose, warp.step_between(pose, target))
    np.testing.assert_allclose(found, target, atol=1e-12)


def test_mirrored_landmarks_are_those_of_the_other_side() -> None:
    sample = TRAIN[0]
    assert sorted(MIRRORED) == list(range(68))
    window, points = mirrored_planar(sample.face.window, planar_landmarks(sample))
    assert points[36, 0] < points[45, 0]
    again = mirrored_planar(window, points)[1]
    np.testing.assert_allclose(again, planar_landmarks(sample), atol=1e-9)


def test_units_move_the_landmarks_that_they_are_named_for() -> None:
    rest = with_units(TRAIN[0], (), 1.0).landmarks
    smile = with_units(TRAIN[0], ("AU12",), 1.0).landmarks
    open_mouth = with_units(TRAIN[0], ("AU26",), 1.0)
    brows = with_units(TRAIN[0], ("AU1",), 1.0).landmarks
    assert (smile[[61, 291], 1] < rest[[61, 291], 1] - 0.5).all()
    assert open_mouth.landmarks[14, 1] > rest[14, 1] + 1
    assert (brows[[107, 336], 1] < rest[[107, 336], 1] - 0.3).all()
    inside = open_mouth.landmarks[[13, 14]].mean(0).round().astype(int)
    assert open_mouth.face.window.picture[inside[1], inside[0]].max() < 90


def test_people_are_in_one_part_alone() -> None:
    parts = split_people([*TRAIN, *TRAIN], 3)
    people = [{sample.face.person for sample in part} for part in parts]
    assert sum(map(len, people)) == len(set().union(*people)) == 10


def test_errors_are_relative_to_the_eyes() -> None:
    sample = TRAIN[0]
    moved = planar_landmarks(sample) + np.array([0.1 * sample.eye_distance, 0])
    assert errors(sample, moved) == pytest.approx((100.0, 0.1))


def test_the_linear_range_ends_where_a_displacement_is_not_half_predicted() -> None:
    actual = np.array([-20.0, -10, -5, 5, 10, 20])
    predicted = np.array([-5.0, -9, -5, 5, 20, 19])[:, None]
    curve = PredictionCurve("rx", "deg", actual, predicted)
    assert curve.linear_range == (-10.0, 5.0)
    assert curve.error == pytest.approx((15 + 1 + 0 + 0 + 10 + 1) / 6)


def test_a_start_at_nasion_and_subnasale_has_them_there(pair: dict[str, Contender]) -> None:
    sample = TEST[0]
    for contender in pair.values():
        pose = start_pose(contender, sample, np.zeros(2), 1.0, "n-sn")
        points = contender.warps[0].landmarks(contender.levels[0].shape.mean, pose)
        found = contender.points(points, NOSE_LINE)
        np.testing.assert_allclose(found, sample.landmarks[list(NOSE_LINE)], atol=1e-6)


def test_additive_search_finds_new_faces_and_tables_tell(pair: dict[str, Contender]) -> None:
    options = SearchOptions("additive")
    for contender in pair.values():
        found = generalisation(contender, TEST, options, False, 1)
        still = generalisation(contender, TEST, replace(options, iterations=0), False, 1)
        assert found.nme.mean() < still.nme.mean()
        first, *_, last = convergence(contender, TEST, options, False, 1)
        assert len(last) == options.iterations + 1
        assert first[0] == pytest.approx(still.nme.mean(), rel=0.05)
        assert last[-1] == pytest.approx(found.nme.mean(), rel=0.05)
    part = search_part(pair, TRAIN, TEST, 1)
    text, drawn = part.text, part.files
    assert text.count("| head |") == text.count("| 2D |") == 2 * len(METHODS) + 6
    assert "displaced start, project-out" in text
    assert set(drawn) == {"search_head.png", "search_2D.png", "convergence.svg"}
    sheet = drawn["search_head.png"]
    assert isinstance(sheet, bytes)
    picture = cv2.imdecode(np.frombuffer(sheet, np.uint8), cv2.IMREAD_COLOR)
    # Rows of five tiles for each of the pictures, at least a step of each level.
    assert picture is not None and picture.shape[0] % 5 == 0 and picture.shape[1] >= 4 * 128
    chart = drawn["convergence.svg"]
    assert isinstance(chart, str) and "<svg" in chart


def test_the_time_of_a_search_is_told_for_both_and_every_method(
    pair: dict[str, Contender],
) -> None:
    rows = speed_part(pair, TEST[:2]).text.splitlines()[4:]
    assert [row.split("|")[1].strip() for row in rows] == list(METHODS)
    for row in rows:
        median, p95 = (float(each.strip(" ()")) for each in row.split("|")[2].split("("))
        assert 0 < median <= p95


def test_prediction_and_modes_of_both_are_told(pair: dict[str, Contender]) -> None:
    part = prediction_part(pair, TRAIN, TEST)
    text, plots = part.text, part.files
    assert all(f"| head | {name} |" in text for name in ("rx", "ry", "rz", "tx", "ty", "scale"))
    assert all("polyline" in str(plot) for plot in plots.values())
    assert [each.what.split(":")[0][:14] for each in part.asked[:3]] == ["one prediction"] * 3
    assert len(part.asked) == 6
    model = model_part(pair, TRAIN, TEST, 1)
    assert "9, 81, 33" in model.text and "specificity" in model.text
    assert len(model.asked) == 3 and all(" against " in each.reached for each in model.asked)
    assert "without the forehead" in model.asked[0].reached
    assert list(model.files) == ["variance_head.svg", "variance_2D.svg"]
    assert all("combined" in str(chart) for chart in model.files.values())


def test_the_frame_without_forehead_is_the_full_one_from_the_brows_down() -> None:
    full, lower = (texture_frame(64, frame) for frame in ("full", "landmarks"))
    inside, whole = (set(zip(each.rows, each.columns, strict=True)) for each in (lower, full))
    assert inside < whole
    assert lower.rows.min() > full.rows.min() and lower.rows.max() == full.rows.max()


def test_residual_modes_take_in_what_ae_shapes_leave_of_the_landmarks(
    pair: dict[str, Contender],
) -> None:
    def moved(sample: Sample) -> Sample:
        """The lower part of the face is elsewhere than the head says, alike in everybody."""
        landmarks = np.array(sample.landmarks)
        landmarks[landmarks[:, 1] > landmarks[2, 1]] += [0, 2.5]
        return replace(sample, landmarks=landmarks)

    train, test = [moved(each) for each in TRAIN], [moved(each) for each in TEST]
    richer = train_residual_head(train, replace(OPTIONS, shape_retained=0.97, regression=False))
    assert richer.residual is not None
    controls = richer.residual.modes.mean
    np.testing.assert_allclose(mirrored_controls(mirrored_controls(controls)), controls, atol=1e-9)
    assert best_possible(richer, test).error < 0.4 * best_possible(pair["head"], test).error
    face = richer.prepared(test, 1)[0]
    assert len(face.shape) == SHAPE_COUNT + len(richer.residual.modes.modes)


def test_recognition_counts_every_picture(pair: dict[str, Contender]) -> None:
    sets = (TRAIN[:2], TRAIN[3:4], TEST[:1])
    learned, known, new = (show_faces(pair["head"], each) for each in sets)
    shows = 1 + 2 * (len(EXPRESSIONS) - 1)
    assert learned.texture.shape == (2 * shows, len(pair["head"].levels[-1].texture.mean))
    results = recognise(learned, known, new)
    ways = {"thresholds", "linear", "SVM", "SVM of texture", "SVM of gradients"}
    assert set(results) == {*ways, "SVM less own neutral"}
    assert results["SVM less own neutral"][1] is None
    for way in ways:
        for found in results[way]:
            assert found is not None
            assert found.units["AU26"].shown == 2 * 3
            assert found.units["AU1"].shown == 2 * 4
            assert found.units["Neutral"].shown == 1
    text = tables.unit_table(results["linear"][0], tables.THESIS_KNOWN)
    assert "| AU26 | 6 |" in text and "(74.3)" in text and "(86.1)" in text
    first = results["linear"][1]
    assert first is not None
    # As Table 3.4 prints them.
    independent = tables.unit_table(first, tables.THESIS_NEW)
    assert all(f"({each})" in independent for each in ("76.2", "4.4", "17.7", "74.0", "76.4"))


def test_own_neutral_faces_are_those_of_other_pictures_where_there_are_any() -> None:
    people, pictures = np.array(["a", "a", "a", "b", "c"]), np.array(["1", "1", "2", "3", "4"])
    shown = np.zeros((5, 6))
    shown[1, 0] = shown[4, 0] = 1
    none, texels = np.zeros((5, 1)), np.zeros((5, 1), np.float32)
    faces = ShownFaces(shown, people, pictures, none, none, none, texels, texels)
    features = np.arange(1.0, 6)[:, None]
    own = own_neutrals(features, faces, features, faces)
    # Of c nothing neutral is known.
    np.testing.assert_array_equal(own[:, 0], [3, 3, 1, 4, 0])


def test_first_frames_without_a_face_are_not_right() -> None:
    nme = np.array([0.01, 0.049, 0.06, np.inf])
    frames = FirstFrames(nme, nme - 0.02, nme - 0.05)
    assert (frames.found, frames.right) == (0.75, 0.5)
    assert (frames.right_shifted, frames.right_offset) == (0.75, 0.75)


def test_the_shift_that_all_truth_has_in_common_is_found_among_outliers() -> None:
    random = np.random.default_rng(1)
    truth, found = list[TruePicture](), list[Array | None]()
    for number in range(7):
        landmarks = random.uniform(0, 90, (468, 2))
        landmarks[20:] = np.nan
        truth.append(TruePicture("set", str(number), np.zeros((4, 4, 3), np.uint8), landmarks))
        at = np.nan_to_num(landmarks) + random.normal(np.array([1.5, -2]), 0.1, (468, 2))
        found.append(np.column_stack([at, np.zeros(468)]))
    found[0], found[1] = None, np.zeros((468, 3))
    np.testing.assert_allclose(common_shift(found, truth), [1.5, -2], atol=0.1)
    assert (common_shift([None], truth[:1]) == 0).all()


def test_landmarks_that_truth_has_elsewhere_in_everybody_are_moved_along_the_face() -> None:
    random, empty = np.random.default_rng(4), np.zeros((4, 4, 3), np.uint8)
    meant = random.normal(0, 0.1, (468, 2))
    meant[list(OUTER_EYE_CORNERS)] = 0
    truth, found = list[TruePicture](), list[Array | None]()
    for number, turn in enumerate(random.uniform(-0.5, 0.5, 8)):
        across = random.uniform(40, 80) * np.array([np.cos(turn), np.sin(turn)])
        line = np.array([across, [-across[1], across[0]]])
        points = random.uniform(0, 100, (468, 2))
        right, left = OUTER_EYE_CORNERS
        points[left] = points[right] + across
        points[7] = np.nan
        truth.append(TruePicture("set", str(number), empty, points))
        found.append(points + meant @ line)
    offsets = landmark_offsets([*found[:4], None], truth[:5])
    known = np.arange(468) != 7
    np.testing.assert_allclose(offsets[known], meant[known], atol=1e-9)
    assert (offsets[7] == 0).all() and (landmark_offsets([None], truth[:1]) == 0).all()
    frames = judged_frames({"network": found[4:]}, truth[4:], offsets)["network"]
    assert (frames.nme > 0.05).all() and (frames.nme_offset < 1e-9).all()


def test_first_frames_are_judged_once_by_a_model_without_their_people() -> None:
    empty, points = np.zeros((4, 4, 3), np.uint8), np.zeros((468, 2))
    people = [*sorted({sample.face.person for sample in TRAIN}), "nobody"]
    truth = [TruePicture("set", person, empty, points) for person in people]
    halves, pictures = folds(TRAIN, truth)
    for samples, judged in zip(halves, pictures, strict=True):
        assert not {each.face.person for each in samples} & {each.person for each in judged}
    assert sorted(each.person for part in pictures for each in part) == sorted(people)


def test_outcomes_of_a_shown_unit_exclude_each_other() -> None:
    shown, found = np.zeros((6, 6)), np.zeros((6, 6), bool)
    shown[2:, 0], shown[5, 1] = 1.0, 0.6
    found[1, 3] = True
    found[[2, 3], 0] = True
    found[3, 4] = found[4, 4] = found[5, 1] = True
    result = judged_units(found.astype(float), shown, found)
    neutral, first, second = (result.units[name] for name in ("Neutral", "AU1", "AU2"))
    assert (neutral.right, neutral.false) == (1, 1)
    assert (first.right, first.false, first.missed, first.confused) == (1, 1, 1, 1)
    assert (second.right, second.shown) == (1, 1)
    assert result.units["AU15"].false_positive_rate == pytest.approx(2 / 6)
    assert first.f1 == pytest.approx(2 * 2 / (2 * 2 + 0 + 2))
    assert result.share("right") == pytest.approx(3 / 7)
    assert result.share("false") == pytest.approx(2 / 7)


def test_thresholds_let_as_much_false_pass_as_is_told() -> None:
    random = np.random.default_rng(2)
    shown = (random.random((3000, 6)) < 0.15).astype(float)
    strengths = shown + random.normal(0, 0.4, shown.shape)
    for share in (0.017, 0.1):
        found = found_units(strengths, shown, strengths, share)
        result = judged_units(strengths, shown, found)
        assert 0.3 * share < result.share("false") <= share
    assert area_under_curve(strengths[:, 0], shown[:, 0] > 0) > 0.9
    assert area_under_curve(np.zeros(4), np.array([True, False, True, False])) == 0.5


def test_people_of_the_training_set_are_no_test() -> None:
    with pytest.raises(ValueError, match="people of train"):
        list(run_experiments(TRAIN, TRAIN[:1], [], 64, PARTS, lambda text: None))


def test_better_is_counted_picture_by_picture() -> None:
    one = Generalisation(np.array([1.0, 2, 3, 4]), np.array([0.01, 0.02, 0.06, 0.04]))
    other = Generalisation(np.array([2.0, 3, 4, 1]), np.zeros(4))
    assert one.better_than(other) == 0.75
    assert one.right == 0.75
    assert tables.table(["a"], [[1]]) == "| a |\n|---|\n| 1 |\n"


def test_what_is_asked_is_told_as_reached_missed_or_in_parts() -> None:
    assert verdict({"": True}) == "reached" and verdict({"x": False, "y": False}) == "missed"
    assert verdict({"x": True, "y": False, "z": True}) == "x, z reached, y missed"
    asked = Asked("error", "below 2", "1.5", "reached")
    table = asked_table([asked_rows("model", [asked]), asked_rows("variants", [])])
    assert table.splitlines()[-1] == "| error | below 2 | 1.5 | reached | model |"
    assert len(table.splitlines()) == 5


def test_training_is_timed_and_judged(pair: dict[str, Contender]) -> None:
    part = training_part(TRAIN[:6], replace(OPTIONS, cascade=False, regression=False))
    assert part.asked[0].verdict == "reached" and "of CPU" in part.text
