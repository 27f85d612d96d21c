"""Speed of the decoder's rendering: `python -m scripts.render_speed`.

Prints for each picture size the median and least milliseconds a frame of animating the head,
warping the background, setting a new texture, and rendering with readback, and the frames a second
of the sum of the medians.
"""

import argparse
import time
from collections.abc import Sequence

import numpy as np

from decoder.rendering.renderer import Renderer
from decoder.scene import EDGE_EXPANSION_PX, edge_samples
from scripts.command import run
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, pose_from_euler
from shared_model.layers.head_motion import make_background_mesh, warp
from shared_model.parameters import AAUS, EAUS
from shared_model.surround import head_with_surround

SIZES = ((176, 144), (320, 240), (640, 480), (1280, 720))
FRAMES = 100
STAGES = ("animate", "warp", "texture", "draw")


def measure_stages_ms(width: int, height: int) -> np.ndarray:
    """(FRAMES, len(STAGES)) milliseconds, after frames that warm up."""
    head, camera = head_with_surround(), Camera(width, height, 1.3 * height)
    face = Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices)))
    reference = pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 600.0]))
    background_mesh = make_background_mesh(camera, reference, head, head.vertices)
    rng = np.random.default_rng(0)
    atlas = rng.integers(0, 256, (256, 256, 3), dtype=np.uint8)
    background = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    times = np.zeros((FRAMES + 5, len(STAGES) + 1))
    with Renderer(width, height, head, edge_samples(width, height)) as renderer:
        renderer.set_texture(atlas)
        renderer.set_background(background, background_mesh.grid_px)
        for row, phase in zip(times, np.linspace(0, 6.28, len(times)), strict=True):
            shift = np.array([30 * np.sin(phase), 0.0, 0.0])
            pose = pose_from_euler(3, 15 * np.cos(phase), 2, reference.translation_mm + shift)
            eau = rng.uniform(0, 0.3, len(EAUS))
            row[0] = time.perf_counter()
            vertices = face.animate(eau)
            row[1] = time.perf_counter()
            grid_px = warp(background_mesh, pose, vertices)
            row[2] = time.perf_counter()
            renderer.set_texture(atlas)
            row[3] = time.perf_counter()
            renderer.draw(camera, pose, vertices, grid_px, expansion_px=EDGE_EXPANSION_PX)
            row[4] = time.perf_counter()
    return np.asarray(1000 * np.diff(times[5:], axis=1))


def main(arguments: Sequence[str]) -> None:
    """Measure every size and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.parse_args(arguments)
    for width, height in SIZES:
        ms = measure_stages_ms(width, height)
        median, least = np.median(ms, axis=0), ms.min(axis=0)
        stages = "  ".join(
            f"{name} {median_ms:.2f} ({minimum:.2f})"
            for name, median_ms, minimum in zip(STAGES, median, least, strict=True)
        )
        print(f"{width}x{height}: {stages} ms, {1000 / median.sum():.0f} frames a second")


if __name__ == "__main__":
    run(main)
