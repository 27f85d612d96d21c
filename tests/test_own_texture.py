"""The caller's own textured model: recovers known motion under changed light, knows a stranger."""

from dataclasses import replace

import numpy as np
import pytest

from decoder.render import Renderer
from encoder.own_texture import LEARN_EVERY, OwnTexture, Synthesis
from encoder.photometric import retinex
from loopback.skin import painted_colours
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, euler_deg, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, FaceParameters

HEAD = generic_head()
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))
CAMERA = Camera(256, 224, 360.0)
PLACE = np.array([5.0, -4.0, 520.0])
REST = FaceParameters(pose_from_euler(0, 0, 0, PLACE))
JAW = EAU_INDEX["jaw_drop"]


class Studio:
    """Draws the painted head with noise."""

    def __init__(self) -> None:
        self._renderer = Renderer(CAMERA.width, CAMERA.height, HEAD, samples=4)
        self._colours = painted_colours(HEAD, mottle=0.15, seed=3)
        self._random = np.random.default_rng(2)

    def draw(self, face: FaceParameters, light: float = 1.0) -> np.ndarray:
        vertices = FACE.animate(face.eau)
        drawn = self._renderer.draw_shaded(CAMERA, face.pose, vertices, self._colours)
        noisy = light * drawn + self._random.normal(0, 2, drawn.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio()


def own_texture(studio: Studio) -> OwnTexture:
    return OwnTexture(HEAD, FACE, CAMERA, studio.draw(REST), REST, 96)


def moved_face() -> FaceParameters:
    eau = np.zeros(len(EAUS))
    eau[JAW] = 0.3
    return FaceParameters(pose_from_euler(1.5, 2, -2, PLACE + np.array([2, -1.5, 6])), eau)


def off_deg(found: FaceParameters, truth: FaceParameters) -> float:
    return float(np.abs(np.subtract(euler_deg(found.pose), euler_deg(truth.pose))).max())


@pytest.mark.parametrize("light", [1.0, 0.75, 1.2])
def test_a_known_motion_is_recovered_under_any_light(studio: Studio, light: float) -> None:
    truth = moved_face()
    found = own_texture(studio).refine(studio.draw(truth, light), REST, [JAW], 12)
    assert found.correlation > 0.9
    assert off_deg(found.face, truth) < 0.7
    assert found.face.eau[JAW] == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize("side", [1, -1])
def test_a_shadow_over_half_the_face_misleads_the_luma_alone(studio: Studio, side: int) -> None:
    truth = moved_face()
    away_px = side * (np.arange(CAMERA.width) - CAMERA.width / 2)
    gain = 0.35 + 0.65 / (1 + np.exp(-np.clip(away_px / 8, -30, 30)))
    picture = np.asarray(np.rint(studio.draw(truth) * gain[None, :, None]), np.uint8)
    by_luma = own_texture(studio)
    by_retinex = OwnTexture(HEAD, FACE, CAMERA, studio.draw(REST), REST, 96, Synthesis(retinex))
    off = [
        off_deg(texture.refine(picture, REST, [JAW], 12).face, truth)
        for texture in (by_luma, by_retinex)
    ]
    assert off[1] < 2 and off[1] < 0.4 * off[0]


def test_actuators_that_are_not_followed_stay_where_they_were(studio: Studio) -> None:
    brow = EAU_INDEX["eyebrow_inner"]
    start = replace(REST, eau=np.where(np.arange(len(EAUS)) == brow, 0.2, 0.0))
    found = own_texture(studio).refine(studio.draw(moved_face()), start, [JAW], 6)
    assert found.face.eau[brow] == 0.2


def test_a_wall_does_not_look_like_the_caller(studio: Studio) -> None:
    random = np.random.default_rng(4)
    wall = random.integers(0, 256, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
    assert own_texture(studio).refine(wall, REST, [JAW], 4).correlation < 0.4


def test_a_face_outside_the_picture_is_no_error_and_no_match(studio: Studio) -> None:
    away = replace(REST, pose=replace(REST.pose, translation_mm=np.array([4000.0, 0, 520])))
    found = own_texture(studio).refine(studio.draw(REST), away, [JAW], 4)
    assert np.isfinite(found.face.pose.translation_mm).all()
    assert found.correlation < 0.4


def test_what_the_first_picture_hid_is_learned_as_the_head_turns(studio: Studio) -> None:
    texture = own_texture(studio)
    turned = replace(REST, pose=pose_from_euler(0, 32, 0, PLACE))
    picture = studio.draw(turned, 0.9)
    before = texture.texels_known
    for _ in range(LEARN_EVERY):
        texture.learn(picture, texture.refine(picture, turned, [JAW], 3))
    assert texture.texels_known > before
    again = texture.refine(picture, turned, [JAW], 3)
    assert again.correlation > 0.85 and off_deg(again.face, turned) < 1.5
