"""Analysis by synthesis recovers rendered faces."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.appearance.texel_visibility import visible_texels
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import crop_face
from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.fitting.increments import apply_increment
from runtime.image_ops import sample_bicubic
from shared_model.appearance import atlas_of
from shared_model.geometry import euler_deg
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters, Pose

MOVED = [EAU_INDEX[name] for name in ("jaw_drop", "mouth_corners", "eyebrow_middle")]


@pytest.fixture(scope="module")
def shape(shots: Shots) -> ShapeFreeFrame:
    return ShapeFreeFrame(shots.face, atlas_of(shots.face.head, 128), shots.camera)


def template_of(shots: Shots, shape: ShapeFreeFrame, number: int) -> Template:
    """A template from one picture; texels that it does not show have no weight."""
    face = shots.faces[number]
    vertices = shots.face.animate(face.eau)
    seen = visible_texels(shape.atlas, face.pose, vertices)
    worn = shots.face.head.opacity[shape.atlas.corners].min(1) > 0.99
    mean = sample_bicubic(luma_f32(shots.pictures[number]), shape.positions(face))[:, 0]
    return Template(mean, np.zeros((0, len(shape)), np.float32), (worn & seen).astype(np.float32))


def refiner_of(shots: Shots, shape: ShapeFreeFrame, number: int) -> TexelFitter:
    return TexelFitter(shots.face, shape, template_of(shots, shape, number))


def astray(face: FaceParameters, seed: int) -> FaceParameters:
    """The face with typical errors of landmarks: a degree, a millimetre, 0.1 of actuators."""
    rng = np.random.default_rng(seed)
    step = np.zeros(6 + len(EAUS))
    step[:3] = rng.normal(size=3) * np.radians(1.0)
    step[3:6] = rng.normal(size=3) * (1.0, 1.0, 4.0)
    step[6 + np.array(MOVED)] = rng.normal(size=len(MOVED)) * 0.1
    return apply_increment(face, step)


def angle_deg(one: Pose, other: Pose) -> float:
    return float(np.abs(np.array(euler_deg(one)) - np.array(euler_deg(other))).max())


@pytest.mark.parametrize("number", range(0, 7, 2))
def test_pose_and_actuators_are_recovered(shots: Shots, shape: ShapeFreeFrame, number: int) -> None:
    truth = shots.faces[number]
    start = astray(truth, number)
    fitter = refiner_of(shots, shape, number)
    found = fitter.fit_crop(whole(shots.pictures[number]), start, 8, MOVED)
    assert angle_deg(found.pose, truth.pose) < 0.3
    shift = found.pose.translation_mm - truth.pose.translation_mm
    assert np.abs(shift[:2]).max() < 0.5 and abs(shift[2]) < 4
    assert np.abs((found.eau - truth.eau)[MOVED]).max() < 0.06


def test_a_crop_gives_the_same_accuracy_as_the_whole_picture(
    shots: Shots, shape: ShapeFreeFrame
) -> None:
    truth, picture = shots.faces[4], shots.pictures[4]
    crop = crop_face(picture, np.nan_to_num(shots.points[4], nan=160.0), 1.0)
    fitter = refiner_of(shots, shape, 4)
    found = [fitter.fit_crop(view, astray(truth, 9), 4, MOVED) for view in (crop, whole(picture))]
    assert angle_deg(found[0].pose, found[1].pose) < 0.02
    assert found[0].eau == pytest.approx(found[1].eau, abs=0.01)


def test_inactive_actuators_keep_their_values(shots: Shots, shape: ShapeFreeFrame) -> None:
    start = astray(shots.faces[2], 5)
    fitter = refiner_of(shots, shape, 2)
    found = fitter.fit_crop(whole(shots.pictures[2]), start, 3, [EAU_INDEX["jaw_drop"]])
    still = [index for index in range(len(EAUS)) if index != EAU_INDEX["jaw_drop"]]
    assert np.array_equal(found.eau[still], start.eau[still])
    assert found.eau[EAU_INDEX["jaw_drop"]] != start.eau[EAU_INDEX["jaw_drop"]]


def test_the_coefficient_of_an_illumination_is_recovered(
    shots: Shots, shape: ShapeFreeFrame
) -> None:
    template = template_of(shots, shape, 3)
    brighter = replace(template, modes=np.full((1, len(shape)), 2.0, np.float32))
    fitter = TexelFitter(shots.face, shape, brighter)
    picture = np.clip(shots.pictures[3].astype(int) + 12, 0, 255).astype(np.uint8)
    found = fitter.fit_crop(whole(picture), astray(shots.faces[3], 3), 5, MOVED)
    assert found.modes == pytest.approx([6.0], abs=0.6)
    assert angle_deg(found.pose, shots.faces[3].pose) < 0.5


def test_a_mode_added_later_is_fitted_like_the_others(shots: Shots, shape: ShapeFreeFrame) -> None:
    rows = np.asarray(np.random.default_rng(5).normal(size=(2, len(shape))) * 3, np.float32)
    template = template_of(shots, shape, 3)
    refiners = [
        TexelFitter(shots.face, shape, replace(template, modes=rows[:known])) for known in (2, 1)
    ]
    picture = whole(shots.pictures[3])
    start = refiners[1].fit_crop(picture, shots.faces[3], 1, MOVED)
    fewer, refiners[1] = refiners[1], refiners[1].with_mode(rows[1])
    found = [fitter.fit_crop(picture, start, 3, MOVED) for fitter in refiners]
    assert len(start.modes) == 1 and len(found[1].modes) == 2
    assert found[1].modes == pytest.approx(found[0].modes)
    assert found[1].eau == pytest.approx(found[0].eau)
    assert len(fewer.template.modes) == 1


def test_a_quarter_of_the_texels_finds_the_face_in_half_the_picture(
    shots: Shots, shape: ShapeFreeFrame
) -> None:
    row = np.asarray(np.random.default_rng(5).normal(size=len(shape)) * 3, np.float32)
    truth, fitter = shots.faces[4], refiner_of(shots, shape, 4)
    crop = crop_face(shots.pictures[4], np.nan_to_num(shots.points[4], nan=160.0), 2.0)
    for each in (fitter, fitter.with_mode(row)):
        halved = each.halved
        assert 0.2 < len(halved.shape) / len(each.shape) < 0.3
        assert len(halved.template.modes) == len(each.template.modes)
        found = halved.fit_crop(crop, astray(truth, 9), 4, MOVED)
        assert angle_deg(found.pose, truth.pose) < 0.6
        assert np.abs((found.eau - truth.eau)[MOVED]).max() < 0.12


def test_an_occluding_hand_hardly_changes_the_fit(shots: Shots, shape: ShapeFreeFrame) -> None:
    picture, truth = shots.pictures[3].copy(), shots.faces[3]
    picture[150:190, 100:150] = (40, 200, 40)
    found = refiner_of(shots, shape, 3).fit_crop(whole(picture), astray(truth, 1), 8, MOVED)
    assert angle_deg(found.pose, truth.pose) < 1.5


def test_a_picture_in_another_light_is_fitted(shots: Shots, shape: ShapeFreeFrame) -> None:
    truth = shots.faces[4]
    found = refiner_of(shots, shape, 3).fit_crop(whole(shots.pictures[4]), shots.faces[3], 8, MOVED)
    assert angle_deg(found.pose, truth.pose) < 1.5
    assert angle_deg(shots.faces[3].pose, truth.pose) > 2


def test_a_few_thousand_texels_are_sampled(shots: Shots) -> None:
    shape = ShapeFreeFrame(shots.face, atlas_of(shots.face.head, 256), shots.camera)
    fitter = refiner_of(shots, shape, 0)
    assert len(shape) > 20000
    assert 1000 < len(fitter.shape) < 10000
    assert fitter.template.mean.shape == (len(fitter.shape),)
    fitter = fitter.with_mode(np.arange(len(shape), dtype=np.float32))
    assert fitter.template.modes.shape == (1, len(fitter.shape))
    assert (np.diff(fitter.template.modes[0]) > 0).all()


def test_hidden_texels_do_not_pull_the_face(shots: Shots, shape: ShapeFreeFrame) -> None:
    truth, picture = shots.faces[2], shots.pictures[2].copy()
    middle = np.nanmean(shots.points[2][:, :2], axis=0)
    hand = middle + np.array([(-35.0, 10.0), (35, 10), (35, 70), (-35, 70)])
    cv2.fillConvexPoly(picture, np.rint(hand).astype(np.int32), (150, 170, 200))
    crop, fitter, start = whole(picture), refiner_of(shots, shape, 2), astray(truth, 3)
    known, unknown = (
        fitter.fit_crop(view, start, 8, MOVED) for view in (crop.hiding([hand]), crop)
    )
    assert angle_deg(known.pose, truth.pose) < min(0.5, angle_deg(unknown.pose, truth.pose))


def test_a_mode_that_nothing_shows_has_a_coefficient_of_zero(
    shots: Shots, shape: ShapeFreeFrame
) -> None:
    truth = replace(shots.faces[2], modes=np.ones(1))
    template = template_of(shots, shape, 2)
    texels = shape.positions(truth)
    at_mouth = np.array(texels[:, 1] > np.nanmedian(texels[:, 1]))
    modes = np.where(at_mouth, 20, 0).astype(np.float32)[None]
    with_mode = replace(template, modes=modes)
    fitter = TexelFitter(shots.face, shape, with_mode)
    low, high = np.nanmin(texels, axis=0), np.nanmax(texels, axis=0)
    half = np.nanmedian(texels[:, 1]) - 3
    hand = np.array([(low[0] - 9, half), (high[0] + 9, half), high + 9, (low[0] - 9, high[1] + 9)])
    found = fitter.fit_crop(whole(shots.pictures[2]).hiding([hand]), truth, 3, MOVED)
    assert found.modes == pytest.approx([0], abs=0.02)
