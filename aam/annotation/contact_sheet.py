"""Contact sheets: every annotated picture with the model drawn on it, beside its texture."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from aam.annotation.annotation_file import Annotation, read_annotation
from aam.shape_space import actuators
from aam.weak_pose import project
from encoder.fitting.landmark_fit import landmark_model
from shared_model.animate import Face, identity_from_controls
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError
from shared_model.mesh import generic_head

TILE_PX = 160
COLUMNS, ROWS = 6, 8
GIVEN_COLOUR, MODEL_COLOUR, TEXT_COLOUR = (60, 60, 255), (80, 220, 80), (255, 255, 255)


def write_contact_sheets(folder: Path, names: Sequence[str]) -> list[Path]:
    """Write contact_000.jpg, ...; the worst fits come first.  Raises `UserError`."""
    annotations = [read_annotation(folder / f"{name}.json") for name in names]
    annotations.sort(key=lambda each: -each.error)
    count = COLUMNS * ROWS
    written = []
    for number, start in enumerate(range(0, len(annotations), count)):
        tiles = [annotation_tile(each) for each in annotations[start : start + count]]
        path = folder / f"contact_{number:03d}.jpg"
        if not cv2.imwrite(str(path), contact_sheet(tiles)):
            raise UserError(f"cannot write {path}")
        written.append(path)
    return written


def contact_sheet(tiles: Sequence[Picture]) -> Picture:
    """Tiles of one size in rows of `COLUMNS`."""
    blank = np.zeros_like(tiles[0])
    filled = [*tiles, *[blank] * (-len(tiles) % COLUMNS)]
    rows = [np.hstack(filled[i : i + COLUMNS]) for i in range(0, len(filled), COLUMNS)]
    return np.asarray(np.vstack(rows), np.uint8)


def annotation_tile(annotation: Annotation) -> Picture:
    """(TILE_PX, 2 TILE_PX, 3): the window with landmarks (red) and model (green), the texture."""
    size = (TILE_PX, TILE_PX)
    window, ratio = annotation.window, TILE_PX / len(annotation.window.picture)
    tile = cv2.resize(window.picture, size, interpolation=cv2.INTER_AREA)
    for points, colour in (
        (annotation.landmarks[:, :2], GIVEN_COLOUR),
        (model_landmarks(annotation), MODEL_COLOUR),
    ):
        for x, y in window.to_window(points[np.isfinite(points[:, 0])]):
            at = (round(float((x + 0.5) * ratio - 0.5)), round(float((y + 0.5) * ratio - 0.5)))
            cv2.circle(tile, at, 1, colour, -1)
    texture = cv2.resize(annotation.texture, size, interpolation=cv2.INTER_AREA)
    text = f"{annotation.name[-22:]} {100 * annotation.error:.1f}%"
    cv2.putText(tile, text, (3, TILE_PX - 5), cv2.FONT_HERSHEY_PLAIN, 0.7, TEXT_COLOUR)
    return np.asarray(np.hstack([tile, texture]), np.uint8)


def model_landmarks(annotation: Annotation) -> Array:
    """(m, 2) pixels of the picture: the landmarks that the head has, under weak perspective."""
    head = generic_head()
    aau, eau = actuators(annotation.shape)
    identity = identity_from_controls(head, aau, annotation.control_mm)
    vertices = Face(head, identity).animate(eau)
    index = landmark_model(head).index
    corners = vertices[head.triangles[head.network_triangles[index]]]
    points = np.einsum("mc,mcd->md", head.network_weights[index], corners)
    return project(annotation.pose, points)
