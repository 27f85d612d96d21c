"""Identity refinement: frames at several angles determine depth that the first frame does not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawn_heads import drawn_picture
from numpy.random import default_rng

from decoder.rendering.renderer import Renderer
from encoder.capture.colour import luma_u8
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.identity import AAU_SIGMA
from encoder.fitting.increments import shared_parameter_count
from encoder.thesis.bundle_adjustment import PhotometricBundleAdjustment
from encoder.thesis.identity_refinement import (
    LATENCY_S,
    MAX_KEYFRAMES,
    SCHEDULE_S,
    IdentityRefiner,
    Keyframe,
    KeyframeSet,
    pose_descriptor,
    validated_adjustment,
)
from encoder.thesis.person_texture import PersonTexture
from shared_model.animate import Face, identity_from_controls
from shared_model.geometry import Camera, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, FaceParameters
from shared_model.shape_residual import control_points, residual_basis

HEAD = generic_head()
CAMERA = Camera(256, 224, 360.0)
ACTIVE = [EAU_INDEX["jaw_drop"], EAU_INDEX["mouth_corners"]]
CONTROL = np.zeros((len(residual_basis(HEAD)), 3))
PLACE = np.array([0.0, 0.0, 420.0])
ANGLES = [(0, 0)] + [(pitch, yaw) for yaw in (-25, 25, -15, 15, -8, 8) for pitch in (-8, 8)]
TIP = HEAD.landmarks["prn"]
Picture = np.ndarray


def guessed(nose_mm: float) -> IdentityFit:
    """An identity whose nose is so much longer than the true one, the generic head's."""
    control = CONTROL.copy()
    control[list(control_points(HEAD)).index(nearest_control(TIP)), 2] = nose_mm
    first = FaceParameters(pose_from_euler(0, 0, 0, PLACE))
    identity = identity_from_controls(HEAD, np.zeros(len(AAUS)), control)
    fitted = IdentityFit(CAMERA, identity, control, (first,))
    shared = shared_parameter_count(fitted)
    # The first frame is known, depths only by what people usually look like.
    precise = np.r_[1e4, np.full(shared - 1, 0.1), np.full(3, 1e4), np.full(3, 1.0)]
    precise[1 : 1 + len(AAUS)] = 1 / AAU_SIGMA**2
    information = np.diag(np.r_[precise, np.full(len(EAUS), 1e4)])
    return replace(fitted, information=information)


def nearest_control(vertex: int) -> int:
    """The control point nearest to a vertex."""
    points = control_points(HEAD)
    away = np.linalg.norm(HEAD.vertices[points] - HEAD.vertices[vertex], axis=1)
    return int(points[away.argmin()])


@pytest.fixture(scope="module")
def film() -> list[tuple[Picture, FaceParameters]]:
    """Luma of the generic head at `ANGLES`, with noise, and its faces."""
    renderer, random = Renderer(CAMERA.width, CAMERA.height, HEAD, samples=4), default_rng(5)
    # Light that stayed where it is would pass for shape: what the head wears is lit evenly.
    coarse = random.integers(60, 200, (40, 40, 3), dtype=np.uint8)
    worn = cv2.resize(coarse, (240, 240), interpolation=cv2.INTER_CUBIC)
    renderer.set_texture(np.asarray(worn, np.uint8))
    u, v = np.linspace(-0.5, CAMERA.width - 0.5, 3), np.linspace(-0.5, CAMERA.height - 0.5, 3)
    renderer.set_background(np.full((8, 8, 3), 130, np.uint8), np.stack(np.meshgrid(u, v), -1))
    face, shots = Face(HEAD, identity_from_controls(HEAD, np.zeros(len(AAUS)), CONTROL)), []
    for pitch, yaw in ANGLES:
        shown = FaceParameters(pose_from_euler(pitch, yaw, 0, PLACE))
        drawn = drawn_picture(renderer, CAMERA, shown.pose, face.animate(shown.eau))
        noisy = drawn + random.normal(0, 2, drawn.shape)
        shots.append((luma_u8(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)), shown))
    renderer.close()
    return shots


def texture_of(film: list[tuple[Picture, FaceParameters]], person: IdentityFit) -> PersonTexture:
    face, (grey, start) = Face(HEAD, person.identity), film[0]
    return PersonTexture(HEAD, face, person.camera, grey, start, 56)


def kept_views(
    film: list[tuple[Picture, FaceParameters]], texture: PersonTexture
) -> list[Keyframe]:
    return [
        Keyframe(texture.observe(grey, face), face, pose_descriptor(face, ACTIVE))
        for grey, face in film[1:]
    ]


def tip_off_mm(fitted: IdentityFit) -> float:
    """Error of the tip of the nose along the optical axis of the first frame, mm."""
    return abs(float(Face(HEAD, fitted.identity).neutral[TIP, 2] - HEAD.vertices[TIP, 2]))


@pytest.mark.parametrize("nose_mm", [-6.0, 6.0])
def test_turned_heads_determine_the_length_of_the_nose(
    film: list[tuple[Picture, FaceParameters]], nose_mm: float
) -> None:
    person = guessed(nose_mm)
    texture = texture_of(film, person)
    first, views = texture.observe(*film[0]), kept_views(film, texture)
    bundle = PhotometricBundleAdjustment(HEAD, person, first.target, ACTIVE)
    better = validated_adjustment(bundle, person, first, views)
    assert better is not None
    assert tip_off_mm(better) < 0.5 * tip_off_mm(person)
    assert better.camera.focal_px == pytest.approx(CAMERA.focal_px, rel=0.05)


def test_a_correct_identity_is_kept(film: list[tuple[Picture, FaceParameters]]) -> None:
    person = guessed(0.0)
    texture = texture_of(film, person)
    first, views = texture.observe(*film[0]), kept_views(film, texture)
    bundle = PhotometricBundleAdjustment(HEAD, person, first.target, ACTIVE)
    better = validated_adjustment(bundle, person, first, views) or person
    assert tip_off_mm(better) < 1
    # Nothing is to be gained from the first frame again, nor where no view is left to check it.
    same = [Keyframe(first, film[0][1], views[0].descriptor)] * 6
    assert validated_adjustment(bundle, person, first, same) is None
    assert validated_adjustment(bundle, person, first, views[:2]) is None


def test_bundle_adjustment_needs_the_first_frames_information(
    film: list[tuple[Picture, FaceParameters]],
) -> None:
    person = replace(guessed(0.0), information=None)
    first = texture_of(film, person).observe(*film[0])
    with pytest.raises(ValueError, match="information"):
        PhotometricBundleAdjustment(HEAD, person, first.target, ACTIVE)


def test_the_most_diverse_keyframes_are_kept(film: list[tuple[Picture, FaceParameters]]) -> None:
    texture = texture_of(film, guessed(0.0))
    view = texture.observe(*film[0])
    keyframes, face = KeyframeSet(), film[0][1]
    random = default_rng(1)
    crowd = [random.normal(0, 0.2, 5) for _ in range(MAX_KEYFRAMES)]
    apart = [np.eye(5)[axis] * side for axis in range(5) for side in (-3.0, 3.0)]
    for place in (*crowd, *apart):
        if keyframes.wants(place):
            keyframes.add(Keyframe(view, face, place))
    assert len(keyframes.keyframes) == MAX_KEYFRAMES
    places = [kept.descriptor.tolist() for kept in keyframes.keyframes]
    assert all(place.tolist() in places for place in apart)
    assert not keyframes.wants(apart[0] + 0.01)
    before = keyframes.keyframes[0].face.pose.translation_mm[2]
    keyframes.change_focal(1.1)
    assert keyframes.keyframes[0].face.pose.translation_mm[2] == pytest.approx(1.1 * before)


def test_a_result_comes_once_and_keyframes_are_added_after_its_adoption(
    film: list[tuple[Picture, FaceParameters]],
) -> None:
    person = guessed(6.0)
    texture = texture_of(film, person)
    refiner = IdentityRefiner(HEAD, person, texture, texture.observe(*film[0]), ACTIVE)
    elapsed_s, came = 0.25, []
    for number in range(round(SCHEDULE_S[0] / elapsed_s) + 12):
        refiner.advance(elapsed_s)
        refiner.add_keyframe_candidate(*film[1 + number % (len(film) - 1)])
        better = refiner.take_result()
        if better is not None:
            came.append((number, better))
            assert refiner.take_result() is None
    assert [number for number, _ in came] == [round((SCHEDULE_S[0] + LATENCY_S) / elapsed_s) - 1]
    refiner.adopt(came[0][1])
