"""The generic head: topology, texture coordinates, landmarks, displacement fields."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from shared_model.arrays import Array, Mask, Picture, VertexIndices
from shared_model.parameters import AAUS, EAUS

PARTS = (
    "skin",
    "eye_left",
    "eye_right",
    "teeth_upper",
    "teeth_lower",
    "tongue",
    "mouth",
    "surround",
)
INSIDE_MOUTH = ("teeth_upper", "teeth_lower", "tongue", "mouth")
# Points of the landmark network around the outer edge of the lips.
OUTER_LIPS = (
    *(61, 146, 91, 181, 84, 17, 314, 405, 321, 375, 291, 409, 270, 269, 267, 0, 37, 39, 40, 185),
)


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """A triangle mesh of n vertices and m triangles, with the fields that animate it.

    vertices: (n, 3) float64, mm, head frame, neutral.
    triangles: (m, 3) int32, counter-clockwise seen from outside.
    texture_coordinates: (n, 2) float64 in [0, 1]: u to the subject's left, v down (row 0 on top).
    parts: (n,) uint8, index into `PARTS`.
    opacity: (n,) float64 in [0, 1]: 1 on the face, 0 where the background picture shows.
    landmarks: anatomical abbreviation of thesis A.1 (sides as `_l`, `_r`) -> vertex index.
    network_triangles: (468,) int32 and network_weights: (468, 3) float64: where each point of the
        468-point landmark network lies on the mesh; negative triangle: not on it.
    eau_up, eau_down: (len(EAUS), n, 3) float64, mm: displacement at +1 and at -1.
    aau: (len(AAUS), n, 3) float64, mm: displacement at +1.
    """

    vertices: Array
    triangles: VertexIndices
    texture_coordinates: Array
    parts: Picture
    opacity: Array
    landmarks: Mapping[str, int]
    network_triangles: VertexIndices
    network_weights: Array
    eau_up: Array
    eau_down: Array
    aau: Array


@cache
def generic_head() -> Head:
    """The generic head that ships with the package (see data/README.md)."""
    with (files("shared_model") / "data" / "head.npz").open("rb") as file:
        data = np.load(file, allow_pickle=False)
        arrays = {name: data[name] for name in data.files}
    names, indices = arrays["landmark_names"], arrays["landmark_vertices"]
    doubles = (
        "vertices",
        "texture_coordinates",
        "opacity",
        "network_weights",
        "eau_up",
        "eau_down",
        "aau",
    )
    head = Head(
        triangles=arrays["triangles"].astype(np.int32),
        parts=arrays["parts"],
        landmarks={str(n): int(i) for n, i in zip(names, indices, strict=True)},
        network_triangles=arrays["network_triangles"].astype(np.int32),
        **{name: arrays[name].astype(np.float64) for name in doubles},
    )
    assert head.eau_up.shape[0] == len(EAUS) and head.aau.shape[0] == len(AAUS)
    return head


def inside_mouth(head: Head) -> Mask:
    """(n,) whether each vertex is one of teeth, tongue or mouth."""
    return np.isin(head.parts, [PARTS.index(part) for part in INSIDE_MOUTH])


def open_edges(triangles: VertexIndices) -> VertexIndices:
    """(k, 2) the edges of exactly one of triangles (m, 3): the boundary of the mesh."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    found: VertexIndices = edges[count == 1]
    return found
