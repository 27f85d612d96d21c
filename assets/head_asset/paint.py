"""Plausible colours for the bare head, so that a landmark network takes it for a face."""

import numpy as np

from assets.head_asset.mesh_parts import Mesh
from shared_model.arrays import Array, Integers

# RGB in [0, 1].
SKIN = (0.86, 0.66, 0.56)
LIPS = (0.72, 0.36, 0.36)
HAIR = (0.18, 0.12, 0.09)
WHITE = (0.92, 0.91, 0.90)
IRIS = (0.30, 0.22, 0.15)
PUPIL = (0.03, 0.03, 0.03)
TEETH = (0.90, 0.88, 0.82)
BAG = (0.25, 0.08, 0.08)
IRIS_RADIUS_MM, PUPIL_RADIUS_MM = 5.9, 2.2
# The brow's centre line, |x| -> y, and half its thickness there, mm.
BROW_X = (10.0, 18.0, 30.0, 40.0, 50.0, 55.0)
BROW_Y = (31.5, 34.0, 37.0, 37.5, 34.0, 31.0)
BROW_HALF = (2.5, 3.5, 3.2, 2.6, 1.6, 0.8)


def pixel_colours(mesh: Mesh, triangle: Integers, weights: Array) -> Array:
    """(k, 3) RGB of points on the neutral head given by triangle (k,) and weights (k, 3)."""
    corners = mesh.triangles[triangle]
    place = (weights[..., None] * mesh.vertices[corners]).sum(1)

    def soft(name: str) -> Array:
        return np.asarray((weights * mesh.masks[name][corners]).sum(1)[:, None])

    colour = np.tile(np.array(SKIN), (len(place), 1))
    colour = _mix(colour, LIPS, np.clip(soft("lips") * 1.5, 0, 1))
    colour = _mix(colour, HAIR, 0.6 * soft("eyelids") ** 2)
    colour = _mix(colour, HAIR, brow_mask(place)[:, None] * 0.85)
    colour = _mix(colour, HAIR, hair_mask(place)[:, None])
    part = mesh.parts[corners[:, 0]]
    for side in (1, 2):
        colour = np.where((part == side)[:, None], _eye(mesh, side, place), colour)
    for group, paint in ((3, TEETH), (4, TEETH), (5, LIPS), (6, BAG)):
        colour = np.where((part == group)[:, None], paint, colour)
    return colour


def brow_mask(place: Array) -> Array:
    """How much hair of the brows is at points (k, 3), mm, of the neutral head."""
    x = np.abs(place[:, 0])
    off = np.abs(place[:, 1] - np.interp(x, BROW_X, BROW_Y)) / np.interp(x, BROW_X, BROW_HALF)
    inside = (x > BROW_X[0]) & (x < BROW_X[-1]) & (place[:, 2] > 40)
    return np.asarray(np.clip(1.5 - off, 0, 1) * inside)


def hair_mask(place: Array) -> Array:
    """How much a point (k, 3), mm, of the neutral head lies under hair."""
    # A hairline that is highest in the middle and comes down in front of the ears.
    line = 88.0 - 0.006 * place[:, 0] ** 2
    front = np.clip((place[:, 1] - line) / 4, 0, 1)
    side = np.clip((6 - place[:, 2]) / 6, 0, 1) * (place[:, 1] > -5)
    return np.asarray(np.maximum(front, side))


def _eye(mesh: Mesh, side: int, place: Array) -> Array:
    points = mesh.vertices[mesh.parts == side]
    centre = (points[:, :2].min(0) + points[:, :2].max(0)) / 2
    away = np.linalg.norm(place[:, :2] - centre, axis=1)[:, None]
    colour = _mix(
        np.tile(np.array(WHITE), (len(place), 1)), IRIS, np.clip(IRIS_RADIUS_MM - away + 0.5, 0, 1)
    )
    return _mix(colour, PUPIL, np.clip(PUPIL_RADIUS_MM - away + 0.5, 0, 1))


def _mix(colour: Array, other: tuple[float, float, float], share: Array) -> Array:
    return np.asarray(colour * (1 - share) + np.array(other) * share)
