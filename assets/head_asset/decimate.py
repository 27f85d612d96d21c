"""Thin the head by symmetric edge collapses under Garland and Heckbert's quadrics.

Vertices are only dropped, never moved: every field of the full mesh carries over by index.
"""

import heapq
from collections.abc import Mapping

import numpy as np

from assets.head_asset.mesh_parts import EYE_LEFT, EYE_RIGHT, MOUTH, SKIN, TONGUE, Mesh
from shared_model.arrays import Array, Integers, Mask

# Vertices to keep of each part on both sides together; other parts stay whole.
BUDGET = {SKIN: 1750, MOUTH: 150, TONGUE: 90}
# How far a collapse may tilt a triangle: cosine between its normals before and after.
LEAST_COSINE = 0.2


def decimate(
    mesh: Mesh, importance: Array, locked: Mask, budget: Mapping[int, int] = BUDGET
) -> Mesh:
    """A thinner mesh.

    importance: (n,) float64, weight of the geometric error at a vertex.
    locked: (n,) bool, vertices that must stay.
    budget: part -> vertices to keep on both sides together.
    """
    left = (mesh.vertices[mesh.triangles][:, :, 0].mean(1) > 0) & (
        mesh.parts[mesh.triangles[:, 0]] != EYE_RIGHT
    )
    fixed = locked | locked[mesh.mirror] | _borders(mesh)
    faces = []
    for part in np.unique(mesh.parts):
        half = mesh.triangles[left & (mesh.parts[mesh.triangles[:, 0]] == part)]
        if part in budget:
            half = _Collapser(mesh.vertices, half, importance, fixed).run(budget[part])
        faces.append(half)
    half = np.concatenate(faces)
    return submesh(mesh, np.concatenate([half, mesh.mirror[half][:, [0, 2, 1]]]))


def submesh(mesh: Mesh, triangles: Integers) -> Mesh:
    """The mesh of these triangles (m, 3) alone, its vertices in their old order."""
    ids, local = np.unique(triangles, return_inverse=True)
    mirror = np.searchsorted(ids, mesh.mirror[ids])
    return Mesh(
        mesh.vertices[ids],
        local.reshape(-1, 3),
        mesh.parts[ids],
        mirror,
        {name: mask[ids] for name, mask in mesh.masks.items()},
        {name: target[ids] for name, target in mesh.targets.items()},
    )


def detach(mesh: Mesh, shown: Mask) -> Mesh:
    """The mesh with `shown` (m,) triangles of skin cut loose: shared vertices doubled, appended.

    Without that the triangles beyond the chart's border would stretch across the chart.
    """
    hidden = ~shown & (mesh.parts[mesh.triangles[:, 0]] == SKIN)
    shared = np.intersect1d(mesh.triangles[shown], mesh.triangles[hidden])
    copy = np.arange(len(mesh.vertices))
    copy[shared] = len(mesh.vertices) + np.arange(len(shared))
    origin = np.concatenate([np.arange(len(mesh.vertices)), shared])
    return Mesh(
        mesh.vertices[origin],
        np.where(hidden[:, None], copy[mesh.triangles], mesh.triangles),
        mesh.parts[origin],
        np.concatenate([mesh.mirror, copy[mesh.mirror[shared]]]),
        {name: mask[origin] for name, mask in mesh.masks.items()},
        {name: target[origin] for name, target in mesh.targets.items()},
    )


def _borders(mesh: Mesh) -> Mask:
    """Vertices on open borders: lids, lips and the mouth bag must go on meeting there."""
    t = mesh.triangles
    edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    pairs, count = np.unique(edges, axis=0, return_counts=True)
    border = np.zeros(len(mesh.vertices), bool)
    border[pairs[count == 1]] = True
    return np.asarray(border & (mesh.parts != EYE_LEFT) & (mesh.parts != EYE_RIGHT))


class _Collapser:
    """Half-edge collapses of one part's left half; the seam x = 0 only collapses along itself."""

    def __init__(
        self, vertices: Array, triangles: Integers, importance: Array, fixed: Mask
    ) -> None:
        self.vertices, self.importance, self.fixed = vertices, importance, fixed
        self.seam = np.abs(vertices[:, 0]) < 1e-6
        self.faces = {i: tuple(int(v) for v in face) for i, face in enumerate(triangles)}
        self.around: dict[int, set[int]] = {}
        for i, face in self.faces.items():
            for v in face:
                self.around.setdefault(v, set()).add(i)
        self.quadrics = self._plane_quadrics(triangles)
        self.version = dict.fromkeys(self.around, 0)

    def run(self, budget: int) -> Integers:
        """Triangles left when about `budget` vertices remain on both sides together."""
        heap: list[tuple[float, int, int, int, int]] = []
        for v in sorted(self.around):
            self._push(heap, v)
        remaining = sum(1 if self.seam[v] else 2 for v in self.around)
        while heap and remaining > budget:
            _, gone, kept, gone_version, kept_version = heapq.heappop(heap)
            stale = (self.version.get(gone), self.version.get(kept)) != (gone_version, kept_version)
            if stale or not self._allowed(gone, kept):
                continue
            remaining -= 1 if self.seam[gone] else 2
            for v in self._collapse(gone, kept):
                self._push(heap, v)
        return np.array([face for _, face in sorted(self.faces.items())])

    def _plane_quadrics(self, triangles: Integers) -> dict[int, Array]:
        corners = self.vertices[triangles]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normal, axis=1, keepdims=True) / 2
        normal = normal / np.maximum(2 * area, 1e-12)
        plane = np.concatenate([normal, -(normal * corners[:, 0]).sum(1, keepdims=True)], 1)
        outer = plane[:, :, None] * plane[:, None, :] * area[:, :, None]
        return {v: outer[sorted(faces)].sum(0) for v, faces in self.around.items()}

    def _neighbours(self, v: int) -> set[int]:
        return {u for face in self.around[v] for u in self.faces[face]} - {v}

    def _push(self, heap: list[tuple[float, int, int, int, int]], v: int) -> None:
        for u in self._neighbours(v):
            for gone, kept in ((v, u), (u, v)):
                if self.fixed[gone] or (self.seam[gone] and not self.seam[kept]):
                    continue
                entry = (self._cost(gone, kept), gone, kept, self.version[gone], self.version[kept])
                heapq.heappush(heap, entry)

    def _cost(self, gone: int, kept: int) -> float:
        place = np.append(self.vertices[kept], 1.0)
        error = place @ (self.quadrics[gone] + self.quadrics[kept]) @ place
        # Flat places thin out evenly too: long edges cost a little.
        length = float(((self.vertices[gone] - self.vertices[kept]) ** 2).sum())
        return float(self.importance[gone] * (error + 0.02 * length**2))

    def _allowed(self, gone: int, kept: int) -> bool:
        shared = self.around[gone] & self.around[kept]
        wings = {v for face in shared for v in self.faces[face]} - {gone, kept}
        # Otherwise the surface would fold onto itself (link condition).
        if self._neighbours(gone) & self._neighbours(kept) != wings:
            return False
        for face in self.around[gone] - shared:
            before = self.vertices[list(self.faces[face])]
            after = self.vertices[[kept if v == gone else v for v in self.faces[face]]]
            old, new = (np.cross(c[1] - c[0], c[2] - c[0]) for c in (before, after))
            sizes = np.linalg.norm(old) * np.linalg.norm(new)
            longest = max(
                float(((after[i] - after[j]) ** 2).sum()) for i, j in ((0, 1), (1, 2), (2, 0))
            )
            # Neither flipped nor a sliver (area against its longest edge).
            if old @ new < LEAST_COSINE * sizes or np.linalg.norm(new) < 0.1 * longest:
                return False
        return True

    def _collapse(self, gone: int, kept: int) -> list[int]:
        """Replace `gone` by `kept`; returns the vertices whose edges must be priced anew."""
        for face in sorted(self.around.pop(gone)):
            old = self.faces[face]
            if kept in old:
                del self.faces[face]
                for v in old:
                    if v != gone:
                        self.around[v].discard(face)
            else:
                self.faces[face] = tuple(kept if v == gone else v for v in old)
                self.around[kept].add(face)
        self.quadrics[kept] = self.quadrics[kept] + self.quadrics.pop(gone)
        del self.version[gone]
        changed = [kept]
        self.version[kept] += 1
        return changed
