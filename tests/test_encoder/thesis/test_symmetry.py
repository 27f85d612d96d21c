"""The near half of a turned face replaces the far half."""

import numpy as np
import pytest
from studio import CAMERA, FACE, HEAD, JAW, PLACE, REST, Studio, angle_error_deg, fitted

from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.thesis.person_texture import UPDATE_INTERVAL, PersonTexture
from encoder.thesis.symmetry import (
    MIRROR_DEG,
    MirroredMatrixFitter,
    SymmetricTexelFitter,
    mirror_index,
)
from shared_model.appearance import atlas_of
from shared_model.geometry import pixel_from_head, pose_from_euler
from shared_model.mesh import PARTS
from shared_model.parameters import FaceParameters


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio()


def texture_of(studio: Studio, fitter: type[TexelFitter]) -> PersonTexture:
    return PersonTexture(HEAD, FACE, CAMERA, studio.draw(REST), REST, 96, fitter=fitter)


def turned(yaw: float, off: float = 0.0) -> FaceParameters:
    return FaceParameters(pose_from_euler(off, yaw + off, off, PLACE))


def half_hidden(picture: np.ndarray, face: FaceParameters, near: bool) -> np.ndarray:
    """A white card over one half of a turned face, at some distance from its middle."""
    yaw_right = pixel_from_head(CAMERA, face.pose, np.array([[0.0, -20, 90]]))[0, 0]
    middle = pixel_from_head(CAMERA, face.pose, np.zeros((1, 3)))[0, 0]
    # The nose points to where the far half is.
    to_the_right = (yaw_right > middle) != near
    edge = round(float(yaw_right + (14 if to_the_right else -14)))
    hidden = picture.copy()
    hidden[:, slice(edge, None) if to_the_right else slice(0, edge)] = 255
    return hidden


def test_mirrored_texels_lie_on_opposite_sides() -> None:
    atlas = atlas_of(HEAD, 96)
    twin = mirror_index(atlas)[atlas.rows, atlas.columns]
    skin = HEAD.parts[atlas.corners[:, 0]] == PARTS.index("skin")
    kept = np.flatnonzero((twin >= 0) & skin & skin[twin])
    assert len(kept) > 0.95 * skin.sum()
    assert np.array_equal(twin[twin[kept]], kept)
    points = atlas.points(FACE.neutral)
    apart = np.linalg.norm(points[twin[kept]] * [-1, 1, 1] - points[kept], axis=1)
    assert np.percentile(apart, 95) < 1


@pytest.mark.parametrize("yaw", [-MIRROR_DEG + 4, MIRROR_DEG - 4])
def test_a_slightly_turned_face_is_not_mirrored(studio: Studio, yaw: float) -> None:
    first, picture = studio.draw(REST), studio.draw(turned(yaw))
    textures = (
        PersonTexture(HEAD, FACE, CAMERA, first, REST, 96, fitter=kind)
        for kind in (SymmetricTexelFitter, TexelFitter)
    )
    one, other = (
        fitted(texture, picture, turned(yaw, 1.5), [JAW], 3).face.pose for texture in textures
    )
    assert one.rotation == pytest.approx(other.rotation, abs=1e-12)


@pytest.mark.parametrize("yaw", [-32.0, 32.0])
def test_an_occluder_of_the_far_half_has_no_influence(studio: Studio, yaw: float) -> None:
    picture, start = studio.draw(turned(yaw)), turned(yaw, 1.0)
    texture = texture_of(studio, SymmetricTexelFitter)

    def found(seen: np.ndarray) -> FaceParameters:
        return fitted(texture, seen, start, [JAW], 1).face

    clear = found(picture)
    assert angle_error_deg(found(half_hidden(picture, start, near=False)), clear) < 0.05
    assert angle_error_deg(found(half_hidden(picture, start, near=True)), clear) > 0.5


@pytest.mark.parametrize("yaw", [-32.0, -25.0, 25.0, 32.0])
def test_the_mirrored_half_fits_a_symmetric_face(studio: Studio, yaw: float) -> None:
    """For a symmetric face in symmetric light."""

    def even(degrees: float) -> FaceParameters:
        return FaceParameters(pose_from_euler(0, degrees, 0, PLACE * [0, 1, 1]))

    def drawn(degrees: float) -> np.ndarray:
        sides = studio.draw(even(degrees)), studio.draw(even(-degrees))[:, ::-1]
        return np.asarray(np.rint(np.mean(sides, axis=0)), np.uint8)

    texture = PersonTexture(HEAD, FACE, CAMERA, drawn(0), even(0), 96, fitter=SymmetricTexelFitter)
    found = fitted(texture, drawn(yaw), even(yaw), [JAW], 0)
    assert found.correlation > 0.78
    ahead = fitted(texture, drawn(0), even(0), [JAW], 0)
    assert len(found.face.modes) == len(ahead.face.modes)


@pytest.mark.parametrize("yaw", [-32.0, 32.0])
def test_matrices_of_a_turned_face_do_without_its_far_half(studio: Studio, yaw: float) -> None:
    start = turned(yaw, 1.0)
    texture = texture_of(studio, MirroredMatrixFitter)
    # Its direction is trained where the face is known, as in a call.
    for angle in (0.4 * yaw, 0.8 * yaw, yaw):
        face = turned(angle)
        seen = studio.draw(face)
        for _ in range(UPDATE_INTERVAL):
            texture.update_template(seen, fitted(texture, seen, face, [JAW], 2))
    picture = studio.draw(turned(yaw))

    def found(shown: np.ndarray) -> FaceParameters:
        return fitted(texture, shown, start, [JAW], 2).face

    clear = found(picture)
    assert angle_error_deg(found(half_hidden(picture, start, near=False)), clear) < 0.2
    assert angle_error_deg(found(half_hidden(picture, start, near=True)), clear) > 0.5
