"""Draw the figures of shared_model/data/README.md: python -m assets.head_figures."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from assets.model_figures import DOCS, save
from benchmarks.command import run
from decoder.rendering.render_geometry import part_colours
from decoder.rendering.renderer import Renderer
from risorius.animation.synthetic_skin import painted_colours
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera, camera_from_head, pixel_from_head, pose_from_euler
from shared_model.mesh import PARTS, Head, generic_head
from shared_model.normals import vertex_normals
from shared_model.parameters import Pose

SIDE = 460
CAMERA = Camera(SIDE, SIDE, SIDE * 4.4)
DISTANCE_MM = 1100.0
YAWS_DEG = (0.0, -40.0, -85.0)
# BGR of the outlines of parts in the atlas.
EYES, TEETH = (200, 90, 0), (0, 140, 0)
INK = ((90, 90, 90), EYES, EYES, TEETH, TEETH, (150, 0, 120), (0, 0, 200))
MARK, NETWORK_MARK, LABEL = (0, 0, 220), (0, 170, 0), (160, 60, 0)


def view_poses() -> tuple[Pose, ...]:
    """The head from the front, from the half profile and from the side."""
    centre = np.array([0.0, 5.0, DISTANCE_MM])
    return tuple(pose_from_euler(0, yaw, 0, centre) for yaw in YAWS_DEG)


def atlas_figure(head: Head) -> Picture:
    """The triangles of the atlas, one colour for a part."""
    picture = np.full((2 * SIDE, 2 * SIDE, 3), 255, np.uint8)
    points = np.rint(head.texture_coordinates * (2 * SIDE - 1) * 16).astype(np.int32)
    for triangle in head.triangles:
        outline = points[triangle].reshape(-1, 1, 2)
        cv2.polylines(picture, [outline], True, INK[head.parts[triangle[0]]], 1, cv2.LINE_8, 4)
    return picture


def landmark_figure(renderer: Renderer, head: Head) -> Picture:
    """The landmarks by name on the left half, seen from three sides."""
    normals = vertex_normals(head.vertices, head.triangles)
    tiles = []
    for pose in view_poses():
        tile = renderer.draw_shaded(CAMERA, pose, head.vertices, part_colours(head))
        facing = camera_from_head(Pose(pose.rotation, np.zeros(3)), normals)[:, 2] < 0.1
        for name, vertex in head.landmarks.items():
            if not name.endswith("_r") and not name.startswith("sto_") and facing[vertex]:
                pixel = pixel_from_head(CAMERA, pose, head.vertices[vertex])
                _mark(tile, pixel, MARK, name.removesuffix("_l"))
        tiles.append(tile)
    return np.hstack(tiles)


def network_figure(renderer: Renderer, head: Head) -> Picture:
    """The landmark network's points of the left half on the painted head, from three sides."""
    corners = head.vertices[head.triangles[head.network_triangles]]
    places = (head.network_weights[..., None] * corners).sum(1)
    left = places[places[:, 0] > -1]
    tiles = []
    for pose in view_poses():
        tile = renderer.draw_shaded(CAMERA, pose, head.vertices, painted_colours(head))
        for pixel in pixel_from_head(CAMERA, pose, left):
            _mark(tile, pixel, NETWORK_MARK)
        tiles.append(tile)
    return np.hstack(tiles)


def opacity_figure(renderer: Renderer, head: Head) -> Picture:
    """What belongs to the face (light) and what the still picture shows (dark)."""
    shade = np.rint(60 + 170 * head.opacity).astype(np.uint8)
    colours = np.repeat(shade[:, None], 3, 1)
    colours[head.parts == PARTS.index("mouth")] = 60
    tiles = [renderer.draw_shaded(CAMERA, pose, head.vertices, colours) for pose in view_poses()]
    return np.hstack(tiles)


def _mark(picture: Picture, pixel: Array, colour: tuple[int, int, int], text: str = "") -> None:
    centre = (int(np.rint(pixel[0] * 16)), int(np.rint(pixel[1] * 16)))
    cv2.circle(picture, centre, 28, colour, -1, cv2.LINE_AA, 4)
    place = (centre[0] // 16 + 4, centre[1] // 16 - 2)
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.33, LABEL, 1, cv2.LINE_AA)


def main(arguments: Sequence[str]) -> None:
    """Draw and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=DOCS / "figures")
    folder: Path = parser.parse_args(arguments).folder
    head = generic_head()
    renderer = Renderer(SIDE, SIDE, head, samples=4)
    save("head_atlas", atlas_figure(head), folder)
    save("head_landmarks", landmark_figure(renderer, head), folder)
    save("head_network", network_figure(renderer, head), folder)
    save("head_opacity", opacity_figure(renderer, head), folder)


if __name__ == "__main__":
    run(main)
