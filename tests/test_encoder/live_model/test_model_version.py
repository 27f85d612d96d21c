"""A version of a live call's model never changes: with one more mode it is another."""

import weakref
from dataclasses import replace

import cv2
import numpy as np
import pytest

from encoder.capture.video_source import open_source
from encoder.coding.background import BackgroundImage
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import BUDGETS
from encoder.learning.face_sample import FaceSample
from encoder.learning.incremental_modes import LearnedMode
from encoder.live_model.model_schedule import TrainingFrames
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.model_version import RESERVED_MODES, ModelVersion
from encoder.live_model.warm_up import frontal_landmarks
from shared_model.arrays import Array, Single
from shared_model.geometry import Camera
from shared_model.parameters import FaceParameters
from shared_model.surround import head_with_surround

WIDTH, HEIGHT, FRAMES = 160, 120, 4
START_FRAME = 300


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[ModelVersion, FaceSample]:
    """A version trained on noise, and a frame of it."""
    rng = np.random.default_rng(0)
    pictures = list(rng.integers(100, 156, (FRAMES, HEIGHT, WIDTH, 3), np.uint8))
    path = tmp_path_factory.mktemp("noise") / "0.png"
    cv2.imwrite(str(path), pictures[0])
    points = frontal_landmarks(head_with_surround(), Camera(WIDTH, HEIGHT, 200.0))
    budget = replace(BUDGETS["live"], appearance_bytes=1500, background_bytes=1500, max_modes=2)
    with open_source(str(path.with_name("%d.png"))) as capture:
        background = BackgroundImage(pictures[0])
        trainer = ModelTrainer(
            head_with_surround(),
            capture.format,
            GopStructure(),
            background,
            budget,
            False,
            workers=1,
        )
        version = trainer.train(budget, pictures, [points] * FRAMES, 0)
    return version, version.sample(pictures[0], points)


def mode_of(version: ModelVersion) -> LearnedMode:
    size = len(version.person.appearance.mean)
    luma: Single = np.linspace(-9, 9, size * size, dtype=np.float32)
    return LearnedMode(b"mode", luma.reshape(size, size))


def values(face: FaceParameters) -> list[Array]:
    return [face.pose.rotation, face.pose.translation_mm, face.eau, face.modes]


def test_a_version_stays_as_it_was_when_a_mode_is_learned(
    trained: tuple[ModelVersion, FaceSample],
) -> None:
    version, sample = trained
    before, coded = version.fit(sample), version.transform_faces([version.fit(sample)])
    more = version.with_mode(mode_of(version))
    again = version.fit(sample)
    assert all(np.array_equal(*pair) for pair in zip(values(before), values(again), strict=True))
    assert np.array_equal(version.transform_faces([again]), coded)
    assert len(more.fit(sample).modes) == len(before.modes) + 1
    assert (version.learned_modes, more.learned_modes) == (0, 1)
    assert more.free_slots == RESERVED_MODES - 1


def test_a_face_that_was_fitted_before_a_mode_was_learned_has_none_of_it(
    trained: tuple[ModelVersion, FaceSample],
) -> None:
    version, sample = trained
    face, more = version.fit(sample), version.with_mode(mode_of(version))
    for refit in (more.refit, more.refit_modes):
        assert len(refit(sample, face).modes) == len(face.modes) + 1
    coded = more.transform_faces([face])
    assert coded.shape == version.transform_faces([face]).shape
    assert np.abs(coded[:, -RESERVED_MODES:]).max() < 1e-12


def test_the_decoders_transform_is_the_same_however_many_modes_are_learned(
    trained: tuple[ModelVersion, FaceSample],
) -> None:
    version, _ = trained
    more = version.with_mode(mode_of(version))
    one, other = version.padded_transform, more.padded_transform
    assert one.reserved_modes == other.reserved_modes == RESERVED_MODES
    assert np.array_equal(one.scale_codes, other.scale_codes)
    assert np.array_equal(one.basis, other.basis)


def test_a_version_is_placed_in_the_call_by_its_packet(
    trained: tuple[ModelVersion, FaceSample],
) -> None:
    version, _ = trained
    placed = version.placed_at(70, START_FRAME)
    assert placed.first_packet == 70 and placed.packet.call.start_frame == START_FRAME
    assert version.first_packet == 0 and version.packet.call.start_frame == 0


def test_a_frame_without_time_for_its_layers_has_those_of_the_frame_before(
    trained: tuple[ModelVersion, FaceSample],
) -> None:
    version, sample = trained
    before = replace(version.fit(sample), layers=np.array([1.0, 2.0]))
    assert np.array_equal(version.fit_texels(sample, before).layers, before.layers)
    assert not len(version.fit_texels(sample).layers)


def test_of_frames_that_are_not_trained_from_nothing_is_kept() -> None:
    frames, offered = TrainingFrames(4), list[weakref.ref[Array]]()
    picture = np.zeros((2, 2, 3), np.uint8)
    for number in range(100):
        points = np.full((468, 3), float(number))
        offered.append(weakref.ref(points))
        frames.offer(picture, points)
    del points
    kept = [number for number, each in enumerate(offered) if each() is not None]
    assert [int(each[0, 0]) for each in frames.sample()[1]] == kept
    assert 4 <= len(kept) < 8
