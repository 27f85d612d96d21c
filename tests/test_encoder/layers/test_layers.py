"""Layers learned from a synthetic scene: a wall, and a person before it whose shoulders sway.

The face is a grey ellipse that moves with the head; the shoulders move by themselves, a known way.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from heads import synthetic_head
from hypothesis import given, settings
from hypothesis import strategies as st

from decoder.rendering.layer_colours import NO_CHANGE
from decoder.scene.background_layers import load_background
from decoder.scene.layer_motion import LayerMotion
from encoder.layers.changes import flicker_ratio
from encoder.layers.displacement import dense, origins, pixel_grid, sample
from encoder.layers.layer_model import LayerModel, learn_layers
from encoder.layers.layer_samples import (
    COARSE_SIDE,
    PICTURE_SIDE,
    LayerSamples,
    motion_with_head,
    scaled_shape,
    typical_frame,
)
from encoder.layers.person_picture import person_mask, with_headwear
from encoder.layers.scene import find_scene, scene_picture
from protocol.pictures.foreground_mask import FINE_MASK_SIDE
from protocol.pictures.layered_background import parse_layers
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.layers.head_motion import make_background_mesh, warp
from shared_model.parameters import AAUS, FaceParameters

CAMERA = Camera(160, 120, 200.0)
HEAD = synthetic_head(12, 16)
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))
REST = FaceParameters(pose_from_euler(0, 0, 0, np.array([0.0, 40.0, 900.0])))
FRAMES = 9
# How far the shoulders are to the right in each frame, pixels; and how bright the light is.
SWAY_PX = np.array([0.0, 2, 4, 2, 0, -2, -4, -2, 0])
LIGHT = np.array([0.0, 6, 12, 0, -6, -12, 0, 6, -6])
ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)


def texture(seed: int, low: float, high: float) -> Array:
    """(120, 160, 3) smooth noise with some contrast."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.normal(0, 1, (120, 160, 3)), (0, 0), 2.0)
    return np.asarray(low + (high - low) * np.clip(0.5 + noise / 0.5, 0, 1))


WALL, COAT = texture(1, 150, 220), texture(2, 20, 100)


def shoulders(sway_px: float) -> Array:
    """(120, 160) 0..1: where they are."""
    v, u = np.mgrid[:120, :160]
    return np.asarray(np.clip(60 - np.abs(u - 80 - sway_px), 0, 1) * np.clip(v - 80.0, 0, 1))


def outline_of(face: FaceParameters) -> Array:
    centre = pixel_from_head(CAMERA, face.pose, np.zeros((1, 3)))[0]
    return np.asarray(centre + np.stack([14 * np.cos(ANGLES), 20 * np.sin(ANGLES)], -1))


def picture_of(face: FaceParameters, sway_px: float, light: float = 0.0) -> tuple[Picture, Array]:
    """A frame (120, 160, 3) and the matte (120, 160) of the person in it."""
    alpha = shoulders(sway_px)[..., None]
    coat = np.stack([np.roll(COAT[..., c], round(sway_px), 1) for c in range(3)], -1)
    picture = alpha * coat + (1 - alpha) * WALL + light
    matte = alpha[..., 0].copy()
    for image, colour in ((picture, (120.0,) * 3), (matte, (1.0,))):
        cv2.fillConvexPoly(image, np.rint(outline_of(face)).astype(np.int32), colour)
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8), matte


def samples(light: Array) -> LayerSamples:
    mesh = make_background_mesh(CAMERA, REST.pose, HEAD, HEAD.vertices)
    pictures, mattes = zip(
        *(picture_of(REST, *each) for each in zip(SWAY_PX, light, strict=True)), strict=True
    )
    return LayerSamples(
        mesh,
        (CAMERA.width, CAMERA.height),
        np.array(pictures),
        np.array([cv2.resize(m, (128, 128), interpolation=cv2.INTER_AREA) for m in mattes]),
        (REST,) * FRAMES,
        np.array([outline_of(REST)] * FRAMES),
        np.array([motion_with_head(mesh, FACE, REST)] * FRAMES),
        canonical=0,
        empty=np.zeros((0, 120, 160, 3), np.uint8),
    )


@pytest.fixture(scope="module")
def model() -> LayerModel:
    return learn_layers(FACE, samples(0 * LIGHT))


def test_the_number_of_threads_changes_nothing(model: LayerModel) -> None:
    alone = learn_layers(FACE, replace(samples(0 * LIGHT), workers=1))
    assert np.array_equal(alone.coefficients, model.coefficients)
    assert alone.encode(3000) == model.encode(3000)


def around_the_face(error: Array) -> Array:
    """Errors (h, w), those in the face left out."""
    return np.asarray(error[picture_of(REST, 99)[1] < 0.5])


def test_the_wall_is_found_where_it_is_ever_seen(model: LayerModel) -> None:
    seen = sum(1 - picture_of(REST, sway)[1] for sway in SWAY_PX) > 2
    scene = cv2.resize(model.scene, (160, 120), interpolation=cv2.INTER_LINEAR)
    assert np.abs(scene - WALL).mean(-1)[seen].mean() < 3


def test_the_sway_is_one_field_and_its_coefficients_follow_it(model: LayerModel) -> None:
    assert len(model.fields) == 1
    correlation = np.corrcoef(model.coefficients[:, 0], SWAY_PX)[0, 1]
    assert abs(correlation) > 0.98


@pytest.mark.parametrize("sway", [3.0, -3.0])
def test_a_new_frame_is_fitted_and_drawn(model: LayerModel, sway: float) -> None:
    frame, _ = picture_of(REST, sway)
    coefficients = model.fitter.fit(frame, REST, outline_of(REST))
    still = model.fitter.draw(REST, np.zeros(len(coefficients)))
    moved = model.fitter.draw(REST, coefficients)
    luma = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    luma = cv2.resize(luma, moved.shape[::-1], interpolation=cv2.INTER_AREA).astype(float)
    outside = ~model.fitter.face_region(outline_of(REST))
    before, after = (((luma - drawn)[outside] ** 2).mean() for drawn in (still, moved))
    assert after < 0.35 * before


def test_a_hand_before_the_shoulder_moves_the_rest_little(model: LayerModel) -> None:
    frame, _ = picture_of(REST, 0.0)
    free = model.fitter.fit(frame, REST, outline_of(REST))
    frame[60:, :36] = 130
    coefficients = model.fitter.fit(frame, REST, outline_of(REST))
    low, high = model.fitter.limits.T
    assert (coefficients >= low).all() and (coefficients <= high).all()
    moved_px = np.ptp(SWAY_PX) / np.ptp(model.coefficients[:, 0])
    assert abs(coefficients[0] - free[0]) * moved_px < 1.5


def test_a_camera_that_moves_takes_the_wall_along(model: LayerModel) -> None:
    assert not model.fitter.scene_moves
    shift_px = np.stack([-SWAY_PX, 0.5 * np.abs(SWAY_PX)], -1)
    pictures = []
    for sway, (right, down) in zip(SWAY_PX, shift_px, strict=True):
        alpha = picture_of(REST, sway)[1][..., None]
        matrix = np.array([[1, 0, right], [0, 1, down]])
        moved = cv2.warpAffine(WALL, matrix, (160, 120), borderMode=cv2.BORDER_REFLECT)
        pictures.append(alpha * picture_of(REST, sway)[0] + (1 - alpha) * moved)
    still = samples(0 * LIGHT)
    moving = replace(still, pictures=np.asarray(pictures, np.uint8))
    scene = find_scene(moving)
    assert scene.motion is not None
    # A unit is a hundredth of the longer side.
    away_px = scene.motion[:, :2] * 1.6 - shift_px
    assert np.abs(away_px).max() < 0.5
    assert np.abs(scene.picture - WALL)[10:60, 10:-10].mean() < 6
    assert find_scene(still).motion is None


def test_a_change_of_the_light_is_learned_and_follows_it() -> None:
    lit = learn_layers(FACE, samples(LIGHT))
    count = len(lit.fields)
    assert len(lit.changes) == 1
    assert abs(np.corrcoef(lit.coefficients[:, count], LIGHT)[0, 1]) > 0.98


def test_a_decoder_has_the_same_layers(model: LayerModel) -> None:
    data = model.encode(3000)
    assert 1500 < len(data) <= 3000
    layers = parse_layers(data, CAMERA.width, CAMERA.height)
    assert np.array_equal(layers.fields, model.fields)
    loaded = load_background(data, CAMERA.width, CAMERA.height)
    assert loaded.static is not None
    assert np.abs(loaded.static - model.scene).mean() < 8
    inside = loaded.moving[..., 3] == 255
    assert np.abs(loaded.moving[..., :3] - model.person)[inside].mean() < 8
    rough = load_background(model.encode_rough(900), CAMERA.width, CAMERA.height)
    assert rough.fields_px is not None and len(rough.fields_px) == 0


def test_a_decoder_moves_and_lights_the_layers_as_the_encoder_does() -> None:
    lit = learn_layers(FACE, samples(LIGHT))
    layers = load_background(lit.encode(4000), CAMERA.width, CAMERA.height)
    motion = LayerMotion(lit.fitter.mesh, layers)
    own = motion.own_motion(np.array([2.0]))
    assert own is not None
    grid = warp(lit.fitter.mesh, REST.pose, HEAD.vertices, own)
    expected = (grid - lit.fitter.mesh.grid_px)[2:-2, 2:-2]
    np.testing.assert_allclose(expected, own[2:-2, 2:-2], atol=1e-6)
    coefficients = np.zeros(len(lit.fields) + len(lit.changes))
    assert motion.change(coefficients) is not None
    assert (np.asarray(motion.change(coefficients)) == NO_CHANGE).all()
    # In the brightest frame; the sign of a change is any.
    coefficients[-1] = lit.coefficients[LIGHT.argmax(), -1]
    assert np.asarray(motion.change(coefficients)).mean() > NO_CHANGE + 3
    assert (np.asarray(motion.change(np.zeros(0))) == NO_CHANGE).all()


def test_a_person_who_never_moves_has_no_fields() -> None:
    still = samples(0 * LIGHT)
    still = replace(
        still,
        pictures=np.repeat(still.pictures[:1], FRAMES, 0),
        mattes=np.repeat(still.mattes[:1], FRAMES, 0),
    )
    model = learn_layers(FACE, still)
    assert len(model.fields) == 0 and model.changes == ()
    assert model.fitter.fit(still.pictures[0], REST, outline_of(REST)).shape == (0,)


def test_the_typical_frame_has_the_pose_that_most_have() -> None:
    away = FaceParameters(pose_from_euler(0, 30, 0, np.array([90.0, 40.0, 900.0])))
    assert typical_frame([away, REST, REST]) in (1, 2)
    assert typical_frame([away]) == 0


def test_a_displacement_is_inverted() -> None:
    rng = np.random.default_rng(5)
    motion = 2 * rng.normal(0, 1, (4, 5, 2))
    field = dense(motion, (80, 60), (60, 80))
    at = origins(field)
    np.testing.assert_allclose(at + sample(field, at), pixel_grid((60, 80)), atol=0.1)
    assert scaled_shape((640, 480), 144) == (108, 144)
    assert scaled_shape((50, 40), 144) == (40, 50)


def test_a_mask_that_is_too_narrow_is_widened_to_what_moves_with_the_person() -> None:
    given = samples(0 * LIGHT)
    narrow = np.array([cv2.erode(matte, np.ones((7, 7), np.uint8)) for matte in given.mattes])
    motions = [np.full_like(given.motion[0], [sway, 0]) for sway in SWAY_PX]
    shape = FINE_MASK_SIDE, FINE_MASK_SIDE
    true = cv2.resize(picture_of(REST, 0)[1], shape, interpolation=cv2.INTER_AREA) > 0.5
    wrong = []
    for mattes in (given.mattes, narrow):
        eroded = replace(given, mattes=mattes)
        mask = person_mask(eroded, motions, find_scene(given))
        wrong.append((mask != true)[shape[0] * 7 // 10 : -8, 8:-8].mean())
    assert max(wrong) < 0.02


@pytest.mark.parametrize("worn", [True, False])
def test_what_moves_with_the_head_and_adjoins_it_is_the_persons(worn: bool) -> None:
    given, frames = samples(0 * LIGHT), []
    for sway in 3 * SWAY_PX:
        picture, matte = picture_of(REST, sway)
        hat = np.zeros((120, 160))
        left = 68 + round(sway) * worn
        hat[10:54, left : left + 24] = 1
        frames.append((np.where(hat[..., None] > 0, 60, picture), matte, hat))
    pictures, mattes, hats = map(np.array, zip(*frames, strict=True))
    mattes[:, :54], size = 0, (128, 128)
    mattes, hats = (
        np.array([cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in images])
        for images in (mattes, hats)
    )
    motion = np.array([np.full_like(given.motion[0], [3 * sway, 0]) for sway in SWAY_PX])
    given = replace(given, pictures=pictures.astype(np.uint8), mattes=mattes, motion=motion)
    more = with_headwear(given, find_scene(given)).mattes - given.mattes
    assert np.abs(more - hats * worn)[:, :54].mean() < 0.02


def test_a_head_that_most_frames_cut_ends_where_the_others_show_its_end() -> None:
    given, rise, top = samples(0 * LIGHT), np.array([0, 4, 18, 20, 22, 24, 22, 20, 18]), 16
    pictures, mattes = list[Array](), list[Array]()
    for up in rise:
        picture, matte = picture_of(REST, 0.0)
        hat = np.zeros((120, 160), bool)
        hat[max(top - up, 0) : 54, 68:92] = True
        pictures.append(np.where(hat[..., None], 60, picture))
        whole = np.where(hat, 1.0, matte)
        mattes.append(
            np.asarray(cv2.resize(whole, (128, 128), interpolation=cv2.INTER_AREA), float)
        )
    motion = np.array([np.full_like(given.motion[0], [0, -up]) for up in rise])
    frames = replace(
        given, pictures=np.array(pictures, np.uint8), mattes=np.array(mattes), motion=motion
    )
    mask = person_mask(frames, list(motion), find_scene(frames))
    first = np.flatnonzero(mask[:, FINE_MASK_SIDE // 2])[0]
    assert abs(first - top * FINE_MASK_SIDE / 120) < 4


def test_what_is_behind_the_person_is_learned_where_nobody_is_there() -> None:
    given = samples(0 * LIGHT)
    wall = np.asarray(np.rint(WALL), np.uint8)
    more = replace(given, empty=np.array([wall, wall]))
    errors = [np.abs(scene_picture(each) - WALL)[85:].mean() for each in (given, more)]
    assert errors[1] < 3 < errors[0]


def test_a_margin_makes_the_mask_narrower() -> None:
    of_sway = samples(0 * LIGHT)
    motions, scene = list(of_sway.motion), find_scene(of_sway)
    wide, narrow = (person_mask(of_sway, motions, scene, margin) for margin in (0.0, 1.0))
    assert not (narrow & ~wide).any()
    assert 0.8 * wide.sum() < narrow.sum() < wide.sum()


def test_what_is_drawn_in_other_places_from_frame_to_frame_flickers(model: LayerModel) -> None:
    of_sway, own = samples(0 * LIGHT), model.coefficients
    restless = 3 * np.abs(own).max() * np.where(np.arange(FRAMES) % 2, 1.0, -1.0)[:, None]
    still, true, wild = (
        flicker_ratio(of_sway, model.fitter, coefficients)
        for coefficients in (0 * own, own, np.broadcast_to(restless, own.shape))
    )
    assert still == 0
    assert true < wild > 1


def enlarged(width: int, height: int) -> LayerSamples:
    """The sample of a source of this size that shows the same, as near as its pixels allow."""
    small, ratio = samples(0 * LIGHT), width / CAMERA.width
    camera = Camera(width, height, CAMERA.focal_px * ratio)
    mesh = make_background_mesh(camera, REST.pose, HEAD, HEAD.vertices)
    size = scaled_shape((width, height), PICTURE_SIDE)[::-1]
    return replace(
        small,
        mesh=mesh,
        size=(width, height),
        pictures=np.array([cv2.resize(each, size) for each in small.pictures]),
        outlines_px=small.outlines_px * ratio,
        motion=np.array([motion_with_head(mesh, FACE, REST)] * FRAMES),
        empty=np.zeros((0, *size[::-1], 3), np.uint8),
    )


@pytest.mark.parametrize("size", [(300, 228), (646, 482)])
def test_layers_are_learned_of_sizes_whose_coarse_copies_round_differently(
    size: tuple[int, int],
) -> None:
    twice = scaled_shape(scaled_shape(scaled_shape(size, PICTURE_SIDE)[::-1], 288)[::-1], 144)
    assert twice != scaled_shape(size, 144)
    learned = learn_layers(FACE, enlarged(*size))
    assert len(learned.fields) == 1


@settings(max_examples=20)
@given(st.integers(32, 4096), st.integers(32, 4096))
def test_pictures_that_are_laid_over_each_other_have_one_shape(width: int, height: int) -> None:
    whole = enlarged(width, height).chosen([0])
    for each in (whole, whole.shrunk(288)):
        (frame,) = each.coarse_frames()
        assert frame.luma.shape == frame.outside.shape == frame.origins.shape[:2]
        assert frame.luma.shape == scaled_shape((width, height), COARSE_SIDE)
