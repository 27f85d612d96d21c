"""Render and compare recovers rendered faces."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawn_heads import drawn_picture
from shots import Shots, whole

from decoder.rendering.renderer import Renderer
from encoder.capture.colour import luma_f32
from encoder.detection.landmark_indices import FACE_OVAL
from encoder.fitting.increments import apply_increment
from encoder.fitting.render_and_compare import ImageFitter
from runtime.image_ops import hull_mask
from shared_model.arrays import Array, Picture, Single
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters

SIZE = 96
JAW = EAU_INDEX["jaw_drop"]


def blotches(seed: int, contrast: float) -> Single:
    """(SIZE, SIZE) of smooth noise."""
    noise = np.random.default_rng(seed).normal(size=(SIZE, SIZE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return np.asarray(contrast * smooth / smooth.std(), np.float32)


MEAN, MODE = 128 + blotches(1, 25), blotches(2, 12)


def picture_of(shots: Shots, face: FaceParameters) -> Picture:
    """The rendered face with texture MEAN and its coefficient of MODE, on black."""
    camera = shots.camera
    worn = MEAN + (face.modes[0] if len(face.modes) else 0) * MODE
    grey = np.clip(np.rint(worn), 0, 255).astype(np.uint8)
    with Renderer(camera.width, camera.height, shots.face.head) as renderer:
        renderer.set_texture(np.repeat(grey[..., None], 3, 2))
        return drawn_picture(renderer, camera, face.pose, shots.face.animate(face.eau))


def astray(face: FaceParameters) -> FaceParameters:
    """The face with errors of half a degree, half a millimetre and a little of the jaw."""
    step = np.zeros(6 + len(EAUS))
    step[:3] = np.radians([0.5, -0.4, 0.3])
    step[3:6] = 0.4, -0.5, 1.5
    step[6 + JAW] = 0.05
    return apply_increment(face, step)


def error(shots: Shots, number: int, face: FaceParameters, wanted: Picture) -> float:
    """Mean squared error within the outline, two pixels from where it ends in black."""
    mask = cv2.erode(hull_mask(outline_of(shots, number), wanted.shape[:2]), np.ones((5, 5)))
    return float(np.square(luma_f32(picture_of(shots, face)) - luma_f32(wanted))[mask > 0].mean())


def outline_of(shots: Shots, number: int) -> Array:
    points = shots.points[number][list(FACE_OVAL)]
    return np.asarray(points[np.isfinite(points[:, 0])])


def fitter_of(shots: Shots, modes: int = 1) -> ImageFitter:
    return ImageFitter(shots.face, shots.camera, MEAN, MODE[None][:modes])


@pytest.mark.parametrize("number", [0, 3, 6])
def test_a_rendered_face_is_recovered(shots: Shots, number: int) -> None:
    truth = replace(shots.faces[number], modes=np.array([0.8]))
    picture = picture_of(shots, truth)
    start = replace(astray(truth), modes=np.zeros(1))
    found = fitter_of(shots).fit(whole(picture), start, outline_of(shots, number), 5)
    assert found.eau[JAW] == pytest.approx(truth.eau[JAW], abs=0.05)
    assert found.modes == pytest.approx([0.8], abs=0.05)
    assert error(shots, number, found, picture) < 0.1 * error(shots, number, start, picture)


def test_a_mode_added_later_is_fitted_like_the_others(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.array([0.8]))
    picture, start = picture_of(shots, truth), replace(astray(truth), modes=np.zeros(1))
    before = fitter_of(shots, 0)
    found, known = (
        fitter.fit(whole(picture), start, outline_of(shots, 3), 2)
        for fitter in (before.with_mode(MODE), fitter_of(shots))
    )
    assert found.modes == pytest.approx(known.modes)


def test_coefficients_alone_are_found_and_the_rest_of_the_face_stays(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.array([0.8]))
    picture, outline = whole(picture_of(shots, truth)), outline_of(shots, 3)
    for before in (0.0, 1.5):
        start = replace(truth, modes=np.array([before]))
        found = fitter_of(shots).fit_modes(picture, start, outline)
        assert found.modes == pytest.approx([0.8], abs=0.05)
        assert found.pose is start.pose and found.eau is start.eau
    assert fitter_of(shots).fit_modes(picture, truth, outline + 5000) is truth


def test_adding_a_mode_does_not_change_the_original_fitter(shots: Shots) -> None:
    picture, before = picture_of(shots, shots.faces[3]), fitter_of(shots, 0)
    before.with_mode(MODE)
    assert len(before.fit(whole(picture), shots.faces[3], outline_of(shots, 3)).modes) == 0


def test_one_iteration_reduces_the_error(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.zeros(0))
    picture, start = picture_of(shots, truth), astray(truth)
    found = fitter_of(shots, 0).fit(whole(picture), start, outline_of(shots, 3))
    assert error(shots, 3, found, picture) < 0.2 * error(shots, 3, start, picture)


def test_an_occluding_hand_does_not_bias_the_fit(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.zeros(1))
    picture = picture_of(shots, truth)
    hidden = picture.copy()
    low, high = outline_of(shots, 3).min(0).astype(int), outline_of(shots, 3).max(0).astype(int)
    hidden[(low + high)[1] // 2 :, low[0] : (low + high)[0] // 2] = 230
    found = fitter_of(shots).fit(whole(hidden), astray(truth), outline_of(shots, 3))
    assert error(shots, 3, found, picture) < 0.5 * error(shots, 3, astray(truth), picture)


def test_an_invisible_face_is_returned_unchanged(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.zeros(1))
    picture = whole(picture_of(shots, truth))
    gone = replace(truth, pose=replace(truth.pose, translation_mm=np.array([900.0, 0, 500])))
    behind = replace(truth, pose=replace(truth.pose, translation_mm=np.array([0.0, 0, -50])))
    outline = outline_of(shots, 3)
    fitter = fitter_of(shots)
    assert fitter.fit(picture, gone, outline) is gone
    assert fitter.fit(picture, behind, outline) is behind
    # Nor is there anything to see where the outline has left the picture.
    assert fitter.fit(picture, truth, outline + 5000) is truth


def test_pixels_of_a_large_face_are_subsampled(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.zeros(0))
    picture, start = picture_of(shots, truth), astray(truth)
    large = cv2.resize(picture, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    crop = replace(whole(np.asarray(large, np.uint8)), scale=np.array([3.0, 3.0]))
    found = fitter_of(shots, 0).fit(crop, start, outline_of(shots, 3), 4)
    assert error(shots, 3, found, picture) < 0.2 * error(shots, 3, start, picture)


def test_a_hidden_part_does_not_pull_the_face(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.array([0.8]))
    picture, outline = picture_of(shots, truth), outline_of(shots, 3)
    hand = outline.mean(0) + np.array([(-40.0, 0.0), (40, 0), (40, 70), (-40, 70)])
    # It looks as the face itself, further down.
    covered = np.where(
        hull_mask(hand, picture.shape[:2])[..., None] > 0, np.roll(picture, 4, 0), picture
    )
    crop = whole(np.asarray(covered, np.uint8))
    start = replace(astray(truth), modes=np.zeros(1))
    known = fitter_of(shots).fit(crop.hiding([hand]), start, outline, 5)
    unknown = fitter_of(shots).fit(crop, start, outline, 5)
    assert error(shots, 3, known, picture) < 0.5 * error(shots, 3, start, picture)
    assert error(shots, 3, known, picture) < error(shots, 3, unknown, picture)


def test_coefficients_that_nothing_shows_stay_at_the_mean(shots: Shots) -> None:
    truth = replace(shots.faces[3], modes=np.array([0.8]))
    outline = outline_of(shots, 3)
    low, high = outline.min(0) - 9, outline.max(0) + 9
    everything = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    hidden = whole(picture_of(shots, truth)).hiding([everything])
    for found in (
        fitter_of(shots).fit(hidden, replace(truth, modes=np.ones(1)), outline, 3),
        fitter_of(shots).fit_modes(hidden, replace(truth, modes=np.ones(1)), outline),
    ):
        assert found.modes == pytest.approx([0], abs=1e-3)
        assert found.pose.translation_mm == pytest.approx(truth.pose.translation_mm, abs=1e-3)
