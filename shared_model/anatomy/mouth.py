"""Which lip a vertex belongs to, and how far along the mouth it lies: what keeps the lips apart.

The lips touch, so no distance in space tells them apart; distance along the surface does: from the
upper lip one gets to the lower lip only round a corner of the mouth.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.anatomy.muscles import Points, falloff, ramp

Array = NDArray[np.float64]
# Vertices of different parts at the same place count as joined.
WELD_MM = 0.05
# Share of the half width of the mouth at which its corner begins: there the lips are one.
CORNER_START = 0.93
# Nearly as far from the one lip as from the other, along the surface: in the corner.
CORNER_MM = 8.0


@dataclass(frozen=True, slots=True)
class MouthLine:
    """Every vertex's place relative to the line between the lips.

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
    """Sort the vertices (n, 3) mm of a mesh by the line between the lips.

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
    """(n,) mm along the edges from vertex `source`; infinite where there is no way (Dijkstra)."""
    distance = np.full(len(vertices), np.inf)
    distance[source] = 0.0
    queue = [(0.0, source)]
    while queue:
        so_far, here = heapq.heappop(queue)
        if so_far > distance[here]:
            continue
        for there in neighbours.get(here, ()):
            total = so_far + float(np.linalg.norm(vertices[there] - vertices[here]))
            if total < distance[there]:
                distance[there] = total
                heapq.heappush(queue, (total, there))
    return distance


def _nearest(vertices: Array, point: Array, near: NDArray[np.bool_]) -> int:
    candidates = np.flatnonzero(near)
    return int(candidates[np.linalg.norm(vertices[candidates] - point, axis=1).argmin()])


def _neighbours(
    vertices: Array, triangles: NDArray[np.integer], near: NDArray[np.bool_]
) -> dict[int, set[int]]:
    """Edges among the vertices `near`, with vertices at the same place joined."""
    neighbours: dict[int, set[int]] = {}
    for a, b, c in triangles[near[triangles].all(1)].tolist():
        for i, j in ((a, b), (b, c), (c, a)):
            neighbours.setdefault(i, set()).add(j)
            neighbours.setdefault(j, set()).add(i)
    places: dict[tuple[float, ...], int] = {}
    for i in np.flatnonzero(near).tolist():
        first = places.setdefault(tuple(np.round(vertices[i] / WELD_MM).tolist()), i)
        if first != i:
            neighbours.setdefault(i, set()).add(first)
            neighbours.setdefault(first, set()).add(i)
    return neighbours
