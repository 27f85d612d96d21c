"""The sample that layers are learned from, and its light."""

import numpy as np
from heads import synthetic_head

from encoder.layers.layer_samples import LayerSamples
from encoder.layers.light import in_newest_light
from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.head_motion import make_background_mesh
from shared_model.parameters import FaceParameters

FRAMES, SIZE = 12, (160, 120)


def samples(gains: list[float]) -> LayerSamples:
    """Frames of a room in these lights; the person is a dark stripe in all of them."""
    head, camera = synthetic_head(12, 16), Camera(*SIZE, 200.0)
    rest = FaceParameters(pose_from_euler(0, 0, 0, np.array([0.0, 40.0, 900.0])))
    room = np.random.default_rng(2).integers(20, 230, (15, 20, 3)).repeat(8, 0).repeat(8, 1)
    frames = [np.rint(gain * room).astype(np.uint8) for gain in gains]
    mattes = np.zeros((len(gains), 128, 128), np.float32)
    mattes[:, :, 50:70] = 1
    for picture in frames:
        picture[:, 63:87] = 40
    mesh = make_background_mesh(camera, rest.pose, head, head.vertices)
    motion = np.zeros((len(gains), *mesh.grid_px.shape))
    outlines = np.zeros((len(gains), 4, 2))
    faces = (rest,) * len(gains)
    empty = np.zeros((0, 120, 160, 3), np.uint8)
    return LayerSamples(mesh, SIZE, np.array(frames), mattes, faces, outlines, motion, 0, empty)


def test_a_sample_is_brought_to_the_light_of_its_newest_frame() -> None:
    before = samples([0.6] * 5 + [1.0] * 7)
    after = in_newest_light(before)
    beside = np.r_[0:60, 90:160]
    away = np.abs(after.pictures.astype(int) - before.pictures[-1])[:, :, beside]
    assert len(after.pictures) == FRAMES and away.mean() < 3


def test_frames_that_were_too_dark_are_left_out_but_for_the_canonical_one() -> None:
    before = samples([0.05] * 3 + [1.0] * 9)
    after = in_newest_light(before)
    assert len(after.pictures) == len(after.faces) == len(after.motion) == 10
    assert after.canonical == 0
    few = samples([0.05] * 9 + [1.0] * 3)
    assert len(in_newest_light(few).pictures) == FRAMES


def test_a_sample_of_one_light_stays_as_it_is() -> None:
    before = samples([1.0] * FRAMES)
    assert np.array_equal(in_newest_light(before).pictures, before.pictures)
