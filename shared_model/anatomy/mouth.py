"""Coordinates of vertices relative to the line between the lips, which separate the lips.

Touching lips cannot be told apart by distance in space.  By distance along the surface they can: a
path from the upper lip to the lower one passes a corner of the mouth.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.anatomy.muscles import Points, falloff, ramp
from shared_model.arrays import Array, Mask

# Vertices of different parts within this distance count as joined.
WELD_MM = 0.05
# Where the corner begins, relative to the half width of the mouth; beyond it the lips are one.
CORNER_START = 0.93
# Difference of the surface distances to the lips, mm, below which a vertex is in the corner.
CORNER_MM = 8.0


@dataclass(frozen=True, slots=True)
class MouthLine:
    """The position of each vertex relative to the line between the lips.

    lower: (n,) float64, 1 on the lower lip's side of the line, 0 on the upper one's; between those
        at the corners.
    along: (n,) float64, 0 on the midline, 1 at the corner and beyond.
    above: (n,) float64, mm above the line; not negative on the upper side, not positive on the
        lower one.
    """

    lower: Array
    along: Array
    above: Array


def mouth_line(vertices: Array, triangles: NDArray[np.integer], points: Points) -> MouthLine:
    """The coordinates of the vertices (n, 3) mm of a mesh.

    triangles: (m, 3).  points: landmark -> (3,) mm; needs ls, li, sto_upper, sto_lower and ch_l.
    """
    corner = points["ch_l"]
    reach = 2.2 * float(np.linalg.norm(corner - points["sto_lower"]))
    near = np.linalg.norm(vertices - points["sto_lower"], axis=1) < reach
    neighbours = _neighbours(vertices, triangles, near)
    from_upper = surface_distance(vertices, neighbours, _nearest(vertices, points["ls"], near))
    from_lower = surface_distance(vertices, neighbours, _nearest(vertices, points["li"], near))
    along = np.clip(np.abs(vertices[:, 0]) / (CORNER_START * corner[0]), 0, 1)
    # The line sags from the corners to the middle of the closed mouth.
    middle = (points["sto_upper"][1] + points["sto_lower"][1]) / 2
    line = corner[1] + (middle - corner[1]) * (1 - along**2)
    above = vertices[:, 1] - line
    share = np.where(above < 0, 1.0, 0.0)
    reached = np.isfinite(from_upper) & np.isfinite(from_lower) & (along < 1)
    share[reached] = ramp(from_upper[reached] - from_lower[reached], -CORNER_MM, CORNER_MM)
    return MouthLine(
        share, along, np.where(share > 0.5, np.minimum(above, 0), np.maximum(above, 0))
    )


def upper_lip(line: MouthLine, reach_mm: float) -> Array:
    """(n,) 1 on the upper lip, fading to 0 at the corners and `reach_mm` above the line."""
    return (1 - line.lower) * (1 - line.along**4) * falloff(line.above, reach_mm / 2, reach_mm)


def lower_lip(line: MouthLine, reach_mm: float) -> Array:
    """(n,) 1 on the lower lip, fading to 0 at the corners and `reach_mm` below the line."""
    return line.lower * (1 - line.along**4) * falloff(-line.above, reach_mm / 2, reach_mm)


def surface_distance(vertices: Array, neighbours: dict[int, set[int]], source: int) -> Array:
    """(n,) mm along the edges from vertex `source`; infinite without a path (Dijkstra)."""
    distance = np.full(len(vertices), np.inf)
    distance[source] = 0.0
    queue = [(0.0, source)]
    while queue:
        length, vertex = heapq.heappop(queue)
        if length > distance[vertex]:
            continue
        for neighbour in neighbours.get(vertex, ()):
            total = length + float(np.linalg.norm(vertices[neighbour] - vertices[vertex]))
            if total < distance[neighbour]:
                distance[neighbour] = total
                heapq.heappush(queue, (total, neighbour))
    return distance


def _nearest(vertices: Array, point: Array, near: Mask) -> int:
    candidates = np.flatnonzero(near)
    return int(candidates[np.linalg.norm(vertices[candidates] - point, axis=1).argmin()])


def _neighbours(vertices: Array, triangles: NDArray[np.integer], near: Mask) -> dict[int, set[int]]:
    """The neighbours of each of the vertices `near`; vertices at the same position are joined."""
    neighbours: dict[int, set[int]] = {}
    for a, b, c in triangles[near[triangles].all(1)].tolist():
        for i, j in ((a, b), (b, c), (c, a)):
            neighbours.setdefault(i, set()).add(j)
            neighbours.setdefault(j, set()).add(i)
    joined: dict[tuple[float, ...], int] = {}
    for i in np.flatnonzero(near).tolist():
        first = joined.setdefault(tuple(np.round(vertices[i] / WELD_MM).tolist()), i)
        if first != i:
            neighbours.setdefault(i, set()).add(first)
            neighbours.setdefault(first, set()).add(i)
    return neighbours
