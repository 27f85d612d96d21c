"""Measures of lips, lids, teeth and triangles that have limits at every setting of the face."""

from dataclasses import dataclass

import numpy as np

from shared_model.anatomy.mouth import mouth_line
from shared_model.arrays import Array, Indices, VertexIndices
from shared_model.mesh import PARTS, Head


@dataclass(frozen=True, slots=True)
class Checks:
    """The vertices and triangles that are measured, found once on the neutral head.

    lower_lip, upper_lip: (k,) vertices of the lower lip and the nearest one of the upper lip.
    upper_skin: (u, 3) skin triangles of the upper lip.
    teeth: (j,) vertices of the front teeth.  front: (m, 3) skin triangles in front of them.
    skin: (s, 3) triangles of the face, without the folds at the canthi.
    """

    head: Head
    lower_lip: Indices
    upper_lip: Indices
    upper_skin: VertexIndices
    teeth: Indices
    front: VertexIndices
    skin: VertexIndices

    def lip_overlap_mm(self, vertices: Array) -> float:
        """How far down the upper lip hangs over the lower one, where closest; negative: open."""
        gap = vertices[self.upper_lip, 1] - vertices[self.lower_lip, 1]
        return float(-gap.min())

    def lower_lip_out_mm(self, vertices: Array) -> float:
        """How far the lower lip comes out in front of the upper one where they overlap."""
        return self._in_front(vertices, self.lower_lip, self.upper_skin)

    def lid_below_brow_mm(self, vertices: Array) -> float:
        """How far the margin of the upper lid stays below the top of the brow."""
        marks = self.head.landmarks
        return float(
            min(vertices[marks[f"sci_{s}"], 1] - vertices[marks[f"ps_{s}"], 1] for s in "lr")
        )

    def teeth_through_skin_mm(self, vertices: Array) -> float:
        """How far any front tooth is in front of the lips' skin; negative: behind it."""
        return self._in_front(vertices, self.teeth, self.front)

    def _in_front(self, vertices: Array, points: Indices, triangles: VertexIndices) -> float:
        """How far any of the points is in front of the triangles that cover it along z."""
        found, corners = vertices[points], vertices[triangles]
        low, high = corners[..., :2].min(1), corners[..., :2].max(1)
        at = found[:, None, :2]
        point, triangle = np.nonzero(((low < at) & (at < high)).all(2))
        weights = _frontal_weights(found[point], corners[triangle])
        over = (weights > 0).all(1)
        skin = np.full(len(points), -np.inf)
        height = (weights * corners[triangle, :, 2]).sum(1)
        np.maximum.at(skin, point[over], height[over])
        is_covered = np.isfinite(skin)
        return float((found[is_covered, 2] - skin[is_covered]).max(initial=-np.inf))

    def flipped_share(self, vertices: Array) -> float:
        """Share of the face's area whose triangles have turned by more than 90 degrees."""
        before, after = _normals(self.head.vertices, self.skin), _normals(vertices, self.skin)
        area = np.linalg.norm(before, axis=1)
        return float(area[(before * after).sum(1) < 0].sum() / area.sum())


def find_checks(head: Head) -> Checks:
    """Choose what to look at on this head."""
    v = head.vertices
    points = {name: v[index] for name, index in head.landmarks.items()}
    line = mouth_line(v, head.triangles, points)
    soft = np.isin(head.parts, [PARTS.index("skin"), PARTS.index("mouth")])
    near = soft & (np.abs(line.above) < 5) & (line.along < 0.9) & (v[:, 2] > points["sto"][2] - 16)
    upper, lower = (
        np.flatnonzero(near & (line.lower < 0.1)),
        np.flatnonzero(near & (line.lower > 0.9)),
    )
    away = np.linalg.norm(v[lower][:, None] - v[upper][None], axis=2)
    close = away.min(1) < 5
    teeth = np.isin(head.parts, [PARTS.index("teeth_upper"), PARTS.index("teeth_lower")])
    front_teeth = np.flatnonzero(teeth & (v[:, 2] > 65))
    middle = v[head.triangles].mean(1)
    skin = head.parts[head.triangles[:, 0]] == PARTS.index("skin")
    before = (
        skin & (np.abs(middle[:, 0]) < 40) & (middle[:, 1] < points["prn"][1]) & (middle[:, 2] > 60)
    )
    folds = np.min(
        [np.linalg.norm(middle - points[f"{n}_{s}"], axis=1) for n in ("en", "ex") for s in "lr"],
        axis=0,
    )
    face = skin & (middle[:, 2] > 25) & (folds > 7)
    return Checks(
        head,
        lower[close],
        upper[away.argmin(1)][close],
        head.triangles[before & (line.lower[head.triangles] < 0.1).all(1)],
        front_teeth,
        head.triangles[before],
        head.triangles[face],
    )


def _normals(vertices: Array, triangles: VertexIndices) -> Array:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a))


def _frontal_weights(points: Array, corners: Array) -> Array:
    """(m, 3) barycentric weights of points (m, 3) in triangles (m, 3, 3), seen along z."""
    a, b, c = (corners[:, i, :2] for i in range(3))
    whole = _cross(b - a, c - a)
    whole = np.where(np.abs(whole) < 1e-9, np.inf, whole)
    p = points[:, :2]
    return (
        np.stack([_cross(b - p, c - p), _cross(c - p, a - p), _cross(a - p, b - p)], 1)
        / whole[:, None]
    )


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
