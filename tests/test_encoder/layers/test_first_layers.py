"""The layers of a single frame: what any body and any camera do is followed from it on."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from heads import synthetic_head

from encoder.capture.colour import luma_f32
from encoder.layers.layer_learning import FirstLayers, body_fields, first_layers
from encoder.layers.layer_samples import FittedFrames, coarse_picture
from protocol.pictures.layered_background import parse_layers
from shared_model.animate import Face, Identity
from shared_model.arrays import Picture, Single
from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.light import light_of
from shared_model.parameters import AAUS, FaceParameters

SIZE = 160, 120
CAMERA = Camera(*SIZE, 200.0)
HEAD = synthetic_head(12, 16)
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))
REST = FaceParameters(pose_from_euler(0, 0, 0, np.array([0.0, -60.0, 900.0])))
ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
OUTLINE = np.array([80.0, 46.0]) + np.stack([14 * np.cos(ANGLES), 18 * np.sin(ANGLES)], -1)


def texture(seed: int, low: float, high: float) -> Picture:
    noise = np.random.default_rng(seed).normal(0, 1, (160, 200, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 3.0)
    return np.asarray(low + (high - low) * np.clip(0.5 + smooth / 0.4, 0, 1), np.uint8)


def body_matte(right: int = 0) -> Single:
    v, u = np.mgrid[:120, :160]
    body = (np.abs(u - 80 - right) < 45) & (v > 78)
    head = ((u - 80) / 16.0) ** 2 + ((v - 42) / 24.0) ** 2 < 1
    neck = (np.abs(u - 80) < 10) & (v > 50) & (v < 82)
    return np.asarray(body | head | neck, np.float32)


def frame(body_right: int = 0, scene_right: int = 0) -> Picture:
    """A frame (120, 160, 3) of which the body, or the scene, has moved."""
    wall = texture(1, 150, 230)[20:140, 20 - scene_right : 180 - scene_right]
    coat = texture(2, 20, 110)[20:140, 20 - body_right : 180 - body_right]
    return np.where(body_matte(body_right)[..., None] > 0, coat, wall)


@pytest.fixture(scope="module")
def layers() -> FirstLayers:
    matte = cv2.resize(body_matte(), (128, 128), interpolation=cv2.INTER_AREA)
    return first_layers(frame(), OUTLINE, np.asarray(matte, np.float32))


def frames_of(picture: Picture) -> FittedFrames:
    return FittedFrames(FACE, CAMERA, [picture], [REST], [OUTLINE], 0, REST)


def test_a_body_and_a_scene_that_move_are_followed(layers: FirstLayers) -> None:
    known = layers.frame_layers(frames_of(frame()))
    for picture, body_px in ((frame(body_right=6), 6.0), (frame(scene_right=3), 0.0)):
        own = known.fitted(picture, REST, OUTLINE).layers
        luma = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        size = known.fitter.scene.shape[::-1]
        small = cv2.resize(luma, size, interpolation=cv2.INTER_AREA).astype(np.float64)
        still, moved = (known.fitter.draw(REST, each) for each in (0 * own, own))
        outside = ~known.fitter.face_region(OUTLINE)
        before, after = (((small - each)[outside] ** 2).mean() for each in (still, moved))
        assert after < 0.5 * before
        assert abs(own[0] / 2 - body_px) < 2


def test_a_scene_at_rest_stays_so(layers: FirstLayers) -> None:
    known = layers.frame_layers(frames_of(frame()))
    own = known.fitted(frame(body_right=5), REST, OUTLINE).layers
    assert known.count == len(own) == 10
    assert not own[4:].any()


@pytest.mark.parametrize("body_right", [0, 6])
def test_the_light_is_followed_and_the_body_in_it(layers: FirstLayers, body_right: int) -> None:
    known = layers.frame_layers(frames_of(frame()))
    picture = np.rint(0.7 * frame(body_right).astype(float) + 10).astype(np.uint8)
    own = known.fitted(picture, REST, OUTLINE).layers
    assert abs(own[0] / 2 - body_right) < 2 and not own[4:8].any()
    found = light_of(own[-2:])
    assert found.gain == pytest.approx(0.7, abs=0.04)
    luma = luma_f32(coarse_picture(picture))
    drawn, dark = known.fitter.draw(REST, own), known.fitter.draw(REST, np.zeros(10))
    outside = ~known.fitter.face_region(OUTLINE)
    assert np.abs(luma - drawn)[outside].mean() < 0.3 * np.abs(luma - dark)[outside].mean()


def test_the_jacobian_is_that_of_what_is_drawn(layers: FirstLayers) -> None:
    fitter = layers.frame_layers(frames_of(frame())).fitter
    at = np.array([0.5, 0.2, 0, 0, 0, 0, 0, 0, 12.0, -9.0])
    rows = fitter.jacobian(REST, at)
    for number in (8, 9):
        step = np.eye(10)[number]
        change = fitter.draw(REST, at + step) - fitter.draw(REST, at)
        np.testing.assert_allclose(rows[number], change, atol=0.01)


def test_a_decoder_reads_them_in_the_bytes_they_may_take(layers: FirstLayers) -> None:
    data = layers.encode(4000)
    assert len(data) <= 4000
    parsed = parse_layers(data, *SIZE)
    assert parsed.scene_moves and parsed.light_changes and len(parsed.fields) == 4
    rough = parse_layers(layers.encode_rough(1500), *SIZE)
    assert not rough.scene_moves and not rough.light_changes and not len(rough.fields)


def test_the_head_does_not_move_with_the_body() -> None:
    fields = body_fields(OUTLINE, SIZE)
    rows, columns = fields.shape[1:3]
    assert not fields[:, round(46 / 120 * (rows - 1)), columns // 2].any()
    assert fields[0, -1, :, 0].min() == 1


def test_another_pose_of_the_frame_is_the_reference(layers: FirstLayers) -> None:
    there = replace(REST, pose=pose_from_euler(5, 0, 0, REST.pose.translation_mm))
    frames = replace(frames_of(frame()), faces=[there], reference=there)
    drawn = layers.frame_layers(frames).fitter
    assert drawn.mesh.reference is there.pose
