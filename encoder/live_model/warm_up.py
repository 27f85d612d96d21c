"""Runs an encoder's work once, on noise: what runs for the first time takes long.

Compiled loops are loaded then, or compiled if that has not been done on this machine.  No frame of
a live call may wait for that, and nobody's first call should.  Processes that a loaded process has
become (`runtime.fork_server`) are loaded.
"""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import BackgroundImage
from encoder.coding.gop import GopStructure, gop_for_fps
from encoder.coding.model_packet import BUDGETS
from encoder.coding.rdo_quantiser import code_packet
from encoder.detection.landmark_indices import LANDMARK_COUNT
from encoder.fitting.identity import TYPICAL_FOCAL_RATIO
from encoder.fitting.landmark_fit import landmark_model
from encoder.layers.displacement import dot, moved_back, pixel_grid
from encoder.layers.field_refinement import add_fields, add_pixels
from encoder.layers.layer_drawing import draw_layers
from encoder.layers.person_picture import squared_errors
from encoder.layers.scene import SceneLayer
from encoder.layers.scene_motion import scene_basis, scene_origins
from encoder.learning.incremental_modes import ModeLearner
from encoder.live_model.model_trainer import ModelTrainer
from protocol.frames.temporal_prediction import FramePredictor
from protocol.model_packet import ModelPacket
from runtime.robust_mean import robust_mean
from shared_model.arrays import Array
from shared_model.geometry import Camera, camera_from_head, pixel_from_camera, pose_from_euler
from shared_model.mesh import Head
from shared_model.surround import head_with_surround

# Side of the background, pixels: loops are loaded for any size, and one of the source's size would
# take as long as all the rest.
BACKGROUND_SIDE = 64
# Distance of the face, and the size of its model.
DISTANCE_MM = 600.0
BYTES, MODES, FRAMES = 1500, 2, 2
SAMPLES_PER_S = 8.0
# Of the frame packet, 0 (finest) to 31.
QUALITY = 10
# Grey levels of the noise: more of it takes longer to encode.
GREY = (120, 137)
# A source for which tables are small.
SMALL = VideoFormat(96, 96, Fraction(30), "bt601")


@cache
def load() -> None:
    """Load what any live call needs, in this process and those that it becomes."""
    warm_up(head_with_surround(), SMALL, gop_for_fps(SMALL.fps, None))


def is_loaded() -> bool:
    """Whether `load` has been called, here or in the process that has become this one."""
    return bool(load.cache_info().currsize)


def warm_up(head: Head, video: VideoFormat, gop: GopStructure) -> tuple[ModelPacket, bytes]:
    """Train a model, fit and code a frame, learn a mode: on noise of the source's size, so that all
    tables that depend on the size of the face are there as well.

    Returns the model, and the payload of its first frame packet: who draws can be warmed up by it.
    """
    width, height, rng = video.width, video.height, np.random.default_rng(0)
    points = frontal_landmarks(
        head, Camera(width, height, TYPICAL_FOCAL_RATIO * max(width, height))
    )
    pictures = list(rng.integers(*GREY, (FRAMES, height, width, 3), np.uint8))
    budget = replace(
        BUDGETS["live"], appearance_bytes=BYTES, background_bytes=BYTES, max_modes=MODES
    )
    background = BackgroundImage(pictures[0][:BACKGROUND_SIDE, :BACKGROUND_SIDE])
    trainer = ModelTrainer(head, video, gop, background, budget, progressive=False, workers=1)
    version = trainer.train(budget, pictures, [points] * FRAMES, 0)
    samples = [version.sample(picture, points) for picture in pictures]
    transform = version.padded_transform
    predictor = FramePredictor(transform.scale_codes, transform.reserved_modes)
    values = version.transform_faces([version.fit(samples[0])])
    packet = code_packet(predictor, 0, gop.frames_per_packet, values, QUALITY, intra=True)
    load_layer_loops()
    ModeLearner(version.person, SAMPLES_PER_S).update(samples, version.fit_texels, BYTES, 1)
    return version.placed_at(0, 0).packet, packet.payload


def load_layer_loops() -> None:
    """Load the loops of layers, or compile them: in noise there is nobody to learn layers of."""
    frames, weights = np.zeros((2, 4, 4, 3), np.float32), np.ones((2, 4, 4), np.float32)
    robust_mean(frames.astype(np.uint8), weights, 1)
    mean = robust_mean(frames, weights, 1)
    squared_errors(frames[0], mean, mean)
    moving = SceneLayer(mean, np.zeros((2, 4)))
    moving.origins(0, pixel_grid((4, 4)), (4, 4), (8, 8))
    basis, positions = scene_basis((4, 4)), np.zeros((4, 4, 2), np.float32)
    scene_origins(basis, np.zeros(len(basis)))
    fields, change = basis.copy(), mean[..., :1].copy()
    dot(basis, positions)
    moved_back(positions, np.zeros(len(fields)), fields)
    for by_scene in (basis, fields):
        draw_layers(mean, mean, mean, change, positions, fields, by_scene, np.zeros(9))
    squares, products, pairs = np.zeros((2, 2, 4, 4)), np.zeros((2, 4)), np.zeros((2, 2))
    corners, shares = np.zeros((4, 2), np.intp), np.zeros((4, 2))
    add_pixels(squares, products, corners, shares, pairs, pairs, np.zeros(2, np.float32))
    add_fields(np.zeros((1, 2, 4, 1, 2, 4)), np.ones(1), squares, 2)


def frontal_landmarks(head: Head, camera: Camera) -> Array:
    """(468, 3) landmarks of a neutral face that looks into the camera; pixels."""
    model = landmark_model(head)
    pose = pose_from_euler(0, 0, 0, np.array([0, 0, DISTANCE_MM]))
    in_camera = camera_from_head(pose, model.neutral)
    points = np.zeros((LANDMARK_COUNT, 3))
    points[model.index, :2] = pixel_from_camera(camera, in_camera)
    points[model.index, 2] = (in_camera[:, 2] - DISTANCE_MM) * camera.focal_px / DISTANCE_MM
    return points
