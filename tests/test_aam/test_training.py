"""Training: what the modes explain, what the matrices predict, the same bytes each time, files."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from aam_faces import synthetic_faces, write_annotations

from aam.model import MultiResolutionModel, residual, texture_at
from aam.model_file import read_model, write_model
from aam.pca import principal_components
from aam.search.face_finder import on_network_landmarks
from aam.search.find_face import find_from_eyes, find_in_window, is_explained
from aam.search.search import METHODS, SearchOptions
from aam.training.cascade import NEAR_SHIFT, TURN_SIGMA_RAD, first_states
from aam.training.drawn_displacements import Smoothing, pose_reach
from aam.training.faces import at_resolution, mirrored_face, read_faces, rescaled
from aam.training.report import person_residuals, variance_chart, write_report
from aam.training.ridge import MOMENT_RIDGES, Moments, fit_ridge, ridge_by_halves
from aam.training.train import TrainingOptions, combined_model, train
from aam.warps import head_warp, pose_from_eyes
from benchmarks.validate_aam.weighted_search import SEARCH_WEIGHT, weighted_landmarks
from risorius.cli import main
from shared_model.errors import NO_FACE, UserError

OPTIONS = TrainingOptions(size=64, retained=0.97, normalisation="none", mirror=False)
FACES = synthetic_faces(10, 2)
STRANGERS = synthetic_faces(14, 1)[10:]


@pytest.fixture(scope="module")
def model() -> MultiResolutionModel:
    return train(FACES, OPTIONS)


@pytest.mark.parametrize("size", [(12, 40), (40, 12)])
def test_components_keep_the_least_number_of_orthonormal_modes(size: tuple[int, int]) -> None:
    random = np.random.default_rng(2)
    rows = random.normal(0, 1, size) * np.linspace(3, 0.1, size[1]) + 5
    linear = principal_components(rows, 0.9)
    np.testing.assert_allclose(linear.modes @ linear.modes.T, np.eye(len(linear.modes)), atol=1e-9)
    assert linear.total == pytest.approx(rows.var(0, ddof=1).sum())
    shares = np.cumsum(linear.variances) / linear.total
    assert shares[-1] >= 0.9 > shares[-2]
    np.testing.assert_allclose(
        linear.coefficients(rows).var(0, ddof=1), linear.variances, rtol=1e-9
    )


def test_combined_parameters_give_back_shape_and_texture_of_the_training_faces() -> None:
    warp = head_warp(32, "full")
    prepared = at_resolution(FACES, 32, "none")
    options = TrainingOptions(size=64, retained=0.9999, normalisation="none", mirror=False)
    model, truth = combined_model(prepared, warp, options)
    for face, c in zip(prepared, truth, strict=True):
        np.testing.assert_allclose(model.shape_of(c), face.shape, atol=0.02)
        texture = texture_at(warp, face.luma, face.shape, face.pose)
        assert ((texture - model.texture_of(c)) ** 2).mean() < 0.01


def test_discarded_modes_are_the_first_ones() -> None:
    warp, prepared = head_warp(32, "full"), at_resolution(FACES, 32, "none")
    whole, _ = combined_model(prepared, warp, OPTIONS)
    fewer, _ = combined_model(
        prepared, warp, TrainingOptions(size=64, retained=0.97, discard=2, normalisation="none")
    )
    np.testing.assert_allclose(fewer.combined.modes, whole.combined.modes[2:])
    with pytest.raises(ValueError, match="discard is 99"):
        combined_model(prepared, warp, TrainingOptions(discard=99, normalisation="none"))
    plain = replace(OPTIONS, discard_texture=1)
    fewer, _ = combined_model(prepared, warp, plain)
    np.testing.assert_allclose(fewer.texture.modes, whole.texture.modes[1:])
    with pytest.raises(ValueError, match="discard_texture is 99"):
        combined_model(prepared, warp, replace(OPTIONS, discard_texture=99))


def test_a_mirrored_face_is_where_the_mirror_image_shows_it() -> None:
    warp, face = head_warp(32, "full"), FACES[0]
    mirrored = mirrored_face(face)
    expected = warp.positions(face.shape, face.pose) * [[-1], [1]] + [[95], [0]]
    found = warp.positions(mirrored.shape, mirrored.pose)
    nearest = np.linalg.norm(expected[:, :, None] - found[:, None], axis=0).min(1)
    # The frame's outline is drawn to whole texels, and not quite symmetric.
    assert np.quantile(nearest, 0.97) < 1e-3
    twice = mirrored_face(mirrored)
    np.testing.assert_allclose(twice.pose, face.pose)
    np.testing.assert_array_equal(twice.window.picture, face.window.picture)


def test_rescaled_poses_show_the_same_place_in_a_smaller_picture() -> None:
    warp, face = head_warp(32, "full"), FACES[0]
    small = warp.positions(face.shape, rescaled(face.pose, 0.5))
    np.testing.assert_allclose(
        small, (warp.positions(face.shape, face.pose) + 0.5) / 2 - 0.5, atol=1e-4
    )


def test_a_turned_start_is_not_shifted_by_its_turn() -> None:
    warp, prepared = head_warp(32, "full"), at_resolution(FACES[:2], 32, "none")
    model, _ = combined_model(at_resolution(FACES, 32, "none"), warp, OPTIONS)
    repeats = 200
    states = first_states(model, warp, prepared, repeats, np.random.default_rng(4))
    for number, face in enumerate(prepared):
        corners = warp.landmarks(face.shape, face.pose)[list(warp.eye_corners)]
        eyes = corners.reshape(2, 2, 2).mean(1)
        at_eyes = pose_from_eyes(warp, model.shape_of(states.c[0]), eyes)
        near = states.pose[states.face == number][::2]
        steps = np.array([warp.step_between(at_eyes, pose) for pose in near])
        assert steps[:, :3].std() == pytest.approx(TURN_SIGMA_RAD, rel=0.15)
        shift_px = np.linalg.norm(steps[:, 3:5], axis=1) * np.exp(at_eyes[5])
        shares = shift_px / np.linalg.norm(eyes[1] - eyes[0])
        assert np.sqrt((shares**2).mean()) == pytest.approx(NEAR_SHIFT, rel=0.2)


@pytest.mark.parametrize("columns", [20, 200])
def test_a_ridge_is_chosen_by_what_it_predicts_of_the_other_half(columns: int) -> None:
    random = np.random.default_rng(3)
    rows = random.normal(0, 1, (80, columns)).astype(np.float32)
    true = random.normal(0, 1, (columns, 2)) * (np.arange(columns) < 3)[:, None]
    targets = rows @ true + random.normal(0, 0.1, (80, 2))
    half = np.arange(80) % 2 == 1
    _, predicted = fit_ridge(rows, targets, half, (0.001, 1.0, 1000.0))
    error = {
        ridge: float(((fit_ridge(rows, targets, half, (ridge,))[1] - targets) ** 2).mean())
        for ridge in (0.001, 1.0, 1000.0)
    }
    assert float(((predicted - targets) ** 2).mean()) == pytest.approx(min(error.values()))
    assert min(error.values()) < 0.8 * float((targets**2).mean())


def test_a_ridge_of_moments_is_chosen_for_each_target_by_the_other_half() -> None:
    random = np.random.default_rng(3)
    rows = random.normal(0, 1, (80, 30)).astype(np.float32)
    clear = rows[:, :1] + random.normal(0, 0.01, (80, 1))
    targets = np.hstack([clear, random.normal(0, 1, (80, 1))])
    halves = Moments.of(rows[:40], targets[:40]), Moments.of(rows[40:], targets[40:])
    found = ridge_by_halves([halves], [1.0], slice(None))
    whole = Moments.of(rows, targets)
    np.testing.assert_allclose(found[:, 0], whole.ridge(MOMENT_RIDGES[0])[:, 0], atol=1e-5)
    np.testing.assert_allclose(found[:, 1], whole.ridge(MOMENT_RIDGES[-1])[:, 1], atol=1e-5)
    twice = ridge_by_halves([halves, halves], [0.5, 0.5], slice(0, 1))
    np.testing.assert_allclose(twice, found[:, :1], atol=1e-5)


def test_smoothed_weights_do_what_weights_of_smoothed_samples_do() -> None:
    random, warp = np.random.default_rng(3), head_warp(64, "full")
    smooth, texture = Smoothing(warp), random.normal(0, 1, len(warp.rows)).astype(np.float32)
    samples = smooth.sampled(texture)
    weights = random.normal(0, 1, (2, len(samples)))
    np.testing.assert_allclose(smooth.spread(weights) @ texture, weights @ samples, atol=1e-4)


def test_the_regressed_matrix_sees_how_far_strangers_are_displaced(
    model: MultiResolutionModel,
) -> None:
    level, warp = model.levels[1], model.warp(1)
    prepared = at_resolution(STRANGERS, warp.size, "none")
    for index, reach in enumerate(pose_reach(warp)):
        seen = []
        for face in prepared:
            texture = texture_at(warp, face.luma, face.shape, face.pose)
            c = level.parameters_of(face.shape, texture)
            for share in (-0.8, -0.4, 0.4, 0.8):
                pose = warp.displaced(face.pose, share * reach * np.eye(6)[index])
                left = residual(level, warp, face.luma, pose, c)
                seen.append(float(level.regressed[index] @ left) / reach / share)
        assert 0.7 < np.mean(seen) < 1.2
        assert np.std(seen) < 0.5


@pytest.mark.parametrize("method", METHODS)
def test_strangers_are_found_from_their_eyes(model: MultiResolutionModel, method: str) -> None:
    warps = [model.warp(number) for number in range(len(model.levels))]
    before, after = [], []
    for face in STRANGERS:
        true = warps[-1].landmarks(face.shape, face.pose)
        eyes = true[list(warps[-1].eye_corners)].reshape(2, 2, 2).mean(1)
        start = pose_from_eyes(warps[0], model.levels[0].shape.mean, eyes)
        fit = find_in_window(
            model.levels, warps, "none", face.window, [start], SearchOptions(method)
        )
        distance = np.linalg.norm(eyes[1] - eyes[0])
        mean = warps[-1].landmarks(model.levels[0].shape.mean, start)
        before.append(np.linalg.norm(mean - true, axis=1).mean() / distance)
        after.append(np.linalg.norm(fit.landmarks - true, axis=1).mean() / distance)
    assert np.mean(after) < 0.8 * np.mean(before)


def test_a_face_in_a_larger_picture_is_found_in_its_pixels(model: MultiResolutionModel) -> None:
    face, warp = STRANGERS[0], model.warp(1)
    picture = cv2.copyMakeBorder(face.window.picture, 30, 10, 50, 20, cv2.BORDER_REPLICATE)
    true = warp.landmarks(face.shape, face.pose) + np.array([50, 30])
    eyes = true[list(warp.eye_corners)].reshape(2, 2, 2).mean(1)
    fit = find_from_eyes(model, np.asarray(picture, np.uint8), eyes)
    distance = np.linalg.norm(eyes[1] - eyes[0])
    assert np.linalg.norm(fit.landmarks - true, axis=1).mean() / distance < 0.08
    np.testing.assert_allclose(warp.landmarks(fit.shape, fit.pose), fit.landmarks)


def test_a_face_is_explained_and_noise_is_not(model: MultiResolutionModel) -> None:
    warp = model.warp(1)
    noise = np.random.default_rng(3).integers(0, 255, (96, 96, 3)).astype(np.uint8)
    for face in STRANGERS:
        true = warp.landmarks(face.shape, face.pose)[list(warp.eye_corners)]
        eyes = true.reshape(2, 2, 2).mean(1)
        assert is_explained(model, find_from_eyes(model, face.window.picture, eyes))
        assert not is_explained(model, find_from_eyes(model, noise, eyes))


def test_annotation_by_a_model_leaves_out_pictures_without_its_faces(
    model: MultiResolutionModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_model(tmp_path / "model.npz", model)
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((200, 200, 3), 90, np.uint8))
    by_model = ["--landmarks", str(tmp_path / "model.npz")]
    arguments = ["annotate", str(tmp_path / "empty.png"), "-o", str(tmp_path / "out"), *by_model]
    assert main([*arguments, "-q"]) == NO_FACE
    assert "no face found" in capsys.readouterr().err


def test_landmarks_of_a_model_are_in_the_order_of_the_network(model: MultiResolutionModel) -> None:
    face, warp = STRANGERS[0], model.warp(1)
    corners = warp.landmarks(face.shape, face.pose)[list(warp.eye_corners)]
    fit = find_from_eyes(model, face.window.picture, corners.reshape(2, 2, 2).mean(1))
    points = on_network_landmarks(model, fit)
    np.testing.assert_array_equal(points[warp.landmark_index, :2], fit.landmarks)
    known = np.flatnonzero(np.isfinite(points).all(1))
    np.testing.assert_array_equal(known, np.sort(warp.landmark_index))


def test_a_search_moves_landmarks_of_the_network_a_quarter_of_its_way(
    model: MultiResolutionModel,
) -> None:
    warp, moved = model.warp(1), []
    for face in STRANGERS:
        points = np.full((468, 3), 7.0)
        pose = warp.displaced(face.pose, np.array([0.0, 0.0, 0.0, 4.0, -3.0, 0.03]))
        points[warp.landmark_index, :2] = warp.landmarks(face.shape, pose)
        found = weighted_landmarks(model, face.window.picture, points, pose, face.shape)
        true = warp.landmarks(face.shape, face.pose)
        way, wanted = (
            (each - points[warp.landmark_index, :2]).ravel()
            for each in (found[warp.landmark_index, :2], true)
        )
        moved.append(way @ wanted / (wanted @ wanted))
        assert (found[:, 2] == 7).all()
        assert (np.delete(found, warp.landmark_index, axis=0) == 7).all()
    assert 0.6 * SEARCH_WEIGHT < np.mean(moved) < 1.4 * SEARCH_WEIGHT


def test_landmarks_stay_the_network_s_where_a_search_finds_nothing_better(
    model: MultiResolutionModel,
) -> None:
    face, warp = STRANGERS[0], model.warp(1)
    points = np.zeros((468, 3))
    points[warp.landmark_index, :2] = warp.landmarks(face.shape, face.pose)
    fine = model.levels[1]
    still = replace(fine, cascade=0 * fine.cascade, additive=0 * fine.additive)
    lame = replace(model, levels=(model.levels[0], still))
    found = weighted_landmarks(lame, face.window.picture, points, face.pose, face.shape)
    np.testing.assert_allclose(found, points, atol=1e-9)


def test_a_model_is_the_same_bytes_each_time_and_reads_back(
    model: MultiResolutionModel, tmp_path: Path
) -> None:
    one, other = tmp_path / "one.npz", tmp_path / "other.npz"
    write_model(one, model)
    write_model(other, read_model(one))
    assert one.read_bytes() == other.read_bytes()
    again = read_model(one)
    assert (again.frame, again.normalisation, again.sizes) == ("full", "none", (32, 64))
    np.testing.assert_array_equal(again.levels[1].cascade, model.levels[1].cascade)


def test_what_is_no_model_is_refused(model: MultiResolutionModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    write_model(path, model)
    whole = path.read_bytes()
    for damaged in (b"", whole[:1000], b"x" * 100):
        path.write_bytes(damaged)
        with pytest.raises(UserError, match="no model"):
            read_model(path)
    with np.load(_written(path, whole)) as data:
        arrays = {name: data[name] for name in data.files}
    for change in (
        {"header": np.array(str(arrays["header"]).replace("risorius-aam", "other"))},
        {"header": np.array("{}")},
        {"1/additive": arrays["1/additive"][:, :-1]},
    ):
        np.savez(path, **{**arrays, **change})
        with pytest.raises(UserError, match="no model"):
            read_model(path)
    older = {name: array for name, array in arrays.items() if "regressed" not in name}
    np.savez(path, **older)
    assert read_model(path).levels[1].regressed.shape[0] == 0
    del arrays["0/texture_mean"]
    np.savez(path, **arrays)
    with pytest.raises(UserError, match="texture_mean"):
        read_model(path)


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_the_report_shows_modes_and_every_person(
    model: MultiResolutionModel, tmp_path: Path
) -> None:
    text = write_report(tmp_path, model, FACES, OPTIONS).read_text(encoding="utf-8")
    pictures = ("mean", "combined", "shape", "texture", "weights", "search")
    assert all(f"<img src={name}.png>" in text for name in pictures)
    assert all((tmp_path / f"{name}.png").stat().st_size > 1000 for name in pictures)
    assert "<img src=variance.svg>" in text
    assert variance_chart(model.levels[-1]) == (tmp_path / "variance.svg").read_text()
    assert all(f"<td>p{person}<td>2<td>" in text for person in range(10))
    residuals = person_residuals(model, [*FACES, *STRANGERS])
    strange = np.mean([residuals[face.person][1] for face in STRANGERS])
    known = np.mean([residuals[face.person][1] for face in FACES])
    assert 0 < known < strange < 1


def test_the_command_trains_the_same_model_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_annotations(tmp_path / "in", FACES[:6])
    assert len(read_faces([tmp_path / "in"])) == 6
    for name in ("one.npz", "two.npz"):
        path = str(tmp_path / name)
        report = ["--report", str(tmp_path / "report")] if name == "two.npz" else []
        arguments = ["train", str(tmp_path / "in"), "-o", path, "--size", "64", "--no-mirror"]
        assert main([*arguments, "-q", *report]) == 0
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert "6 faces" in capsys.readouterr().err
    assert (tmp_path / "report" / "index.html").is_file()


def test_the_command_says_what_it_cannot_train_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_annotations(tmp_path / "in", FACES[:3])
    assert main(["train", str(tmp_path / "in"), "-o", str(tmp_path / "m.npz"), "-q"]) == 2
    assert "expected 4 of two people" in capsys.readouterr().err
    assert main(["train", str(tmp_path), "-o", str(tmp_path / "m.npz"), "-q"]) == 2
    assert "no annotations" in capsys.readouterr().err


def test_a_compact_file_finds_the_same_faces(model: MultiResolutionModel, tmp_path: Path) -> None:
    whole, compact = tmp_path / "whole.npz", tmp_path / "compact.npz"
    write_model(whole, model)
    write_model(compact, model, compact=True)
    assert compact.stat().st_size < 0.5 * whole.stat().st_size
    again, face, warp = read_model(compact), STRANGERS[0], model.warp(1)
    corners = warp.landmarks(face.shape, face.pose)[list(warp.eye_corners)]
    eyes = corners.reshape(2, 2, 2).mean(1)
    one, other = (find_from_eyes(each, face.window.picture, eyes) for each in (model, again))
    np.testing.assert_allclose(one.landmarks, other.landmarks, atol=0.5)
