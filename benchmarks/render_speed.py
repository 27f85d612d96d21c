"""Speed of the decoder's rendering: `python -m benchmarks render_speed`.

Prints for each picture size the median and least milliseconds a frame of animating the head,
warping the background, setting a new texture, and rendering with readback, and the frames a second
of the sum of the medians.  With --layers it draws them with layers, too: eight motion fields, two
changes and a scene that moves, instead of one picture with a mask of the person in it.
"""

import argparse
import time
from collections.abc import Sequence
from itertools import product

import numpy as np

from benchmarks.command import run
from decoder.rendering.renderer import FrameState, Renderer
from decoder.scene.background_layers import BackgroundLayers
from decoder.scene.layer_motion import LayerMotion
from decoder.scene.scene import EDGE_EXPANSION_PX
from protocol.pictures.layered_background import SCENE_COEFFICIENTS, change_shape, field_shape
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.head_motion import make_background_mesh, warp
from shared_model.parameters import AAUS, EAUS
from shared_model.surround import head_with_surround

SIZES = ((176, 144), (320, 240), (640, 480), (1280, 720))
FRAMES = 100
STAGES = ("animate", "warp", "texture", "draw")


FIELDS, CHANGES = 8, 2


def layers_of(rng: np.random.Generator, width: int, height: int, layered: bool) -> BackgroundLayers:
    """A background of noise: with layers, or as of one picture with a mask."""
    picture, static = rng.integers(0, 256, (2, height, width, 3), dtype=np.uint8)
    v, u = np.mgrid[:height, :width]
    person = np.abs(u - width / 2) < width / 4 + np.maximum(v - height / 2, 0) / 2
    moving = np.dstack([picture, (255 * person).astype(np.uint8)])
    if not layered:
        return BackgroundLayers(moving, static)
    fields = rng.normal(0, 1, (FIELDS, *field_shape(width, height), 2))
    changes = rng.normal(0, 1, (CHANGES, *change_shape(width, height), 3)).astype(np.float32)
    return BackgroundLayers(moving, static, fields, changes, True)


def measure_stages_ms(width: int, height: int, layered: bool) -> np.ndarray:
    """(FRAMES, len(STAGES)) milliseconds, after frames that warm up.  layered: see --layers."""
    head, camera = head_with_surround(), Camera(width, height, 1.3 * height)
    face = Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices)))
    reference = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 600.0]))
    background_mesh = make_background_mesh(camera, reference, head, head.vertices)
    rng = np.random.default_rng(0)
    atlas = rng.integers(0, 256, (256, 256, 3), dtype=np.uint8)
    layers = layers_of(rng, width, height, layered)
    motion = LayerMotion(background_mesh, layers)
    coefficients = rng.normal(0, 0.2, FIELDS + CHANGES + SCENE_COEFFICIENTS)
    times = np.zeros((FRAMES + 5, len(STAGES) + 1))
    with Renderer(width, height, head) as renderer:
        renderer.set_texture(atlas)
        renderer.set_background(layers.moving, background_mesh.grid_px, layers.static)
        for row, phase in zip(times, np.linspace(0, 6.28, len(times)), strict=True):
            shift = np.array([30 * np.sin(phase), 0.0, 0.0])
            pose = pose_from_euler(3, 15 * np.cos(phase), 2, reference.translation_mm + shift)
            eau = rng.uniform(0, 0.3, len(EAUS))
            row[0] = time.perf_counter()
            vertices = face.animate(eau)
            row[1] = time.perf_counter()
            grid_px = warp(background_mesh, pose, vertices, motion.own_motion(coefficients))
            change, corners = motion.change(coefficients), motion.scene_corners(coefficients)
            row[2] = time.perf_counter()
            renderer.set_texture(atlas)
            row[3] = time.perf_counter()
            state = FrameState(pose, vertices, grid_px, change=change, scene_corners=corners)
            renderer.submit(camera, state, EDGE_EXPANSION_PX)
            renderer.read_back()
            row[4] = time.perf_counter()
    return np.asarray(1000 * np.diff(times[5:], axis=1))


def main(arguments: Sequence[str]) -> None:
    """Measure every size and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--layers", action="store_true", help="measure pictures with layers, too")
    options = parser.parse_args(arguments)
    kinds = (False, True) if options.layers else (False,)
    for (width, height), layered in product(SIZES, kinds):
        ms = measure_stages_ms(width, height, layered)
        median, least = np.median(ms, axis=0), ms.min(axis=0)
        stages = "  ".join(
            f"{name} {median_ms:.2f} ({minimum:.2f})"
            for name, median_ms, minimum in zip(STAGES, median, least, strict=True)
        )
        name = f"{width}x{height}{', layers' if layered else ''}"
        print(f"{name}: {stages} ms, {1000 / median.sum():.0f} frames a second")


if __name__ == "__main__":
    run(main)
