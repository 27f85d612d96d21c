"""Layers of a person whose shoulders follow the head, and of frames that are not all of use."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from heads import synthetic_head

from encoder.layers.displacement import dense, origins, sample
from encoder.layers.layer_model import LayerModel, learn_layers
from encoder.layers.layer_samples import (
    FittedFrames,
    LayerSamples,
    collect_samples,
    motion_with_head,
    reference_mesh,
)
from protocol.pictures.layered_background import FIELD_CODES_PER_PX
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Picture, Single
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.parameters import AAUS, FaceParameters

WIDTH, HEIGHT = SIZE = 160, 120
CAMERA = Camera(WIDTH, HEIGHT, 200.0)
HEAD = synthetic_head(12, 16)
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))
ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
FACE_PX = np.array([14.0, 20.0])


def at_x(x_mm: float) -> FaceParameters:
    """A head so far to the right."""
    return FaceParameters(pose_from_euler(0, 0, 0, np.array([x_mm, 40.0, 900.0])))


# The head goes to and fro by 36 mm, 8 pixels.
FACES = [at_x(x_mm) for x_mm in (0, 9, 18, 9, 0, -9, -18, -9, 0)]


def texture(seed: int, low: float, high: float) -> Single:
    """(HEIGHT, WIDTH, 3) smooth noise with some contrast."""
    white = np.random.default_rng(seed).normal(0, 1, (HEIGHT, WIDTH, 3))
    noise = cv2.GaussianBlur(white, (0, 0), 2.0)
    return np.asarray(low + (high - low) * np.clip(0.5 + noise / 0.5, 0, 1), np.float32)


WALL, COAT = texture(1, 150, 220), texture(2, 20, 100)


def shoulders() -> Single:
    """(HEIGHT, WIDTH) 0..1: where they are while the head is in the middle."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray(np.clip(50 - np.abs(u - 80), 0, 1) * np.clip(v - 80.0, 0, 1), np.float32)


def outline_of(face: FaceParameters) -> Array:
    centre = pixel_from_head(CAMERA, face.pose, np.zeros((1, 3)))[0]
    return np.asarray(centre + FACE_PX * np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1))


def matte_of(picture: Picture, outline_px: Array) -> Single:
    """The person, who is darker than the wall."""
    return np.asarray(picture.max(-1) < 125, np.float32)


def fitted(person: Face = FACE) -> FittedFrames:
    """Frames in which the shoulders go where the mesh of the background goes."""
    outlines = [outline_of(face) for face in FACES]
    frames = FittedFrames(person, CAMERA, [], FACES, outlines, 0, FACES[0])
    mesh, pictures = reference_mesh(frames), []
    for face, outline in zip(FACES, outlines, strict=True):
        at = origins(dense(motion_with_head(mesh, FACE, face), SIZE, (HEIGHT, WIDTH)))
        alpha = sample(shoulders(), at)[..., None]
        picture = alpha * sample(COAT, at) + (1 - alpha) * WALL
        cv2.fillConvexPoly(picture, np.rint(outline).astype(np.int32), (120.0,) * 3)
        pictures.append(np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8))
    return replace(frames, pictures=pictures)


@pytest.fixture(scope="module")
def frames() -> FittedFrames:
    return fitted()


@pytest.fixture(scope="module")
def model(frames: FittedFrames) -> LayerModel:
    return learn_layers(FACE, samples_of(frames))


def samples_of(frames: FittedFrames) -> LayerSamples:
    samples = collect_samples(matte_of, frames)
    assert samples is not None
    return samples


def own_motion_px(model: LayerModel) -> float:
    """How far any point goes to and fro beside its motion with the head."""
    moved = np.tensordot(model.coefficients[:, : len(model.fields)], model.fields, 1)
    return float(np.ptp(moved[..., 0], 0).max() / FIELD_CODES_PER_PX) if len(model.fields) else 0.0


def error(model: LayerModel, picture: Picture, face: FaceParameters, own: Array) -> float:
    """Mean squared error around the face of what the layers draw."""
    drawn = model.fitter.draw(face, own)
    luma = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(luma, drawn.shape[::-1], interpolation=cv2.INTER_AREA)
    outside = ~model.fitter.face_region(outline_of(face))
    return float(((drawn - small)[outside] ** 2).mean())


def test_shoulders_that_follow_the_head_need_no_motion_of_their_own(
    model: LayerModel, frames: FittedFrames
) -> None:
    assert np.ptp(samples_of(frames).motion[..., 0], 0).max() > 5
    assert own_motion_px(model) < 0.5
    none, right = np.zeros(model.frames.count), frames.pictures[2]
    assert error(model, right, FACES[2], none) < 0.5 * error(model, right, FACES[0], none)


def test_frames_without_the_person_are_left_out(frames: FittedFrames) -> None:
    far = float(outline_of(FACES[2])[:, 0].mean())

    def find(picture: Picture, outline_px: Array) -> Single | None:
        is_far = abs(outline_px[:, 0].mean() - far) < 1
        return None if is_far else matte_of(picture, outline_px)

    samples = collect_samples(find, frames)
    assert samples is not None and samples.canonical == 0
    assert samples.faces == (*FACES[:2], *FACES[3:])
    assert len(samples.pictures) == len(samples.mattes) == len(samples.motion) == 8
    assert collect_samples(find, replace(frames, canonical=2)) is None


def test_later_frames_may_go_further_than_the_sample(model: LayerModel) -> None:
    low, high = np.array([[-1.0, 2.0], [0.0, 1.0]]).T
    own = replace(model.frames, fitter=replace(model.fitter, limits=np.stack([low, high], 1)))
    wide = own.with_wide_limits().fitter.limits
    np.testing.assert_allclose(wide, [[-6, 6], [-2, 2]])


def test_a_new_model_of_the_person_keeps_the_layers(
    model: LayerModel, frames: FittedFrames
) -> None:
    nearer = replace(frames, reference=at_x(9))
    other = model.frames.of_person(nearer)
    assert other.fitter.mesh.reference == nearer.reference.pose
    assert other.fitter.person is model.fitter.person and other.count == model.frames.count
    same = model.frames.of_person(frames)
    for own, face in zip(same.fitted_all(frames), FACES, strict=True):
        np.testing.assert_array_equal(own.pose.translation_mm, face.pose.translation_mm)
        assert len(own.layers) == model.frames.count
