"""Strips along the edges of a drawn head, in which it fades into what is behind: smooth edges.

An edge of the mesh between a triangle that faces the camera and one that does not, or none, is an
edge of the picture.  A strip is drawn beyond it in the colours of the edge, its alpha falling over
a pixel (P. Sander, H. Hoppe et al., Discontinuity edge overdraw, 2001).  So edges are smooth with
one colour sample a pixel.
"""

from typing import NamedTuple

import numpy as np

from runtime.jit import jit
from shared_model.arrays import Array, Mask, Single, VertexIndices
from shared_model.mesh import Head, inside_mouth

# Floats of a vertex of a strip: position in clip coordinates (3), texture coordinates (2), opacity,
# light, and distance from the edge, pixels.
VERTEX_FLOATS = 8
# A strip is behind its edge by so much depth, clip coordinates: about a millimetre.
BEHIND = 6e-4
# Two strips meet in a corner at most so many times as far from the edge as their width.
MITRE = 2.0


def welded(head: Head) -> VertexIndices:
    """(n,) for each vertex the first one at its place: there are several at a seam of the atlas."""
    _, first, place = np.unique(head.vertices, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[place.reshape(-1)], np.int32)


class EdgeMesh(NamedTuple):
    """The edges of a head.

    triangles: (m, 3).
    edges: (e, 6) for each of two triangles at an edge, -1: none, that and its vertices there; those
        inside the mouth come last.  Edges at which the head is wholly transparent are left out.
    outside: how many edges come before those inside the mouth.
    weld: (n,), see `welded`.
    """

    triangles: VertexIndices
    edges: VertexIndices
    outside: int
    weld: VertexIndices


def edges_of(head: Head) -> EdgeMesh:
    """Find the edges of a head."""
    weld = welded(head)
    ends = head.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    joined = np.sort(weld[ends], axis=1)
    _, first, of_pair, count = np.unique(
        joined, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    last = np.zeros(len(first), np.int64)
    last[of_pair.reshape(-1)] = np.arange(len(ends))
    second = np.where(count > 1, last // 3, -1)
    edges = np.column_stack([first // 3, ends[first], second, ends[last]])
    edges = edges[head.opacity[edges[:, 1:3]].max(1) > 0]
    inside = inside_mouth(head)[edges[:, 1:3]].all(1)
    ordered = np.ascontiguousarray(np.concatenate([edges[~inside], edges[inside]]), np.int32)
    return EdgeMesh(np.ascontiguousarray(head.triangles), ordered, int((~inside).sum()), weld)


@jit
def edge_strips(
    clip: Array,
    size: tuple[int, int],
    vertices: Array,
    mesh: EdgeMesh,
    shown: Single,
    reach_px: float,
    strips: Single,
) -> tuple[int, int]:
    """Write the strips of a posed head, four vertices each.

    Returns how many there are outside the mouth, which come first, and of all.
    clip: (4, 4), see `render_geometry.clip_from_head`.
    size: of the picture, (width, height), pixels.
    vertices: (n, 3) mm, head frame.
    shown: (n, 4) texture coordinates, opacity and light of each vertex.
    reach_px: how far strips go beyond the edge.
    strips: (e, 4, VERTEX_FLOATS) written.
    """
    flat = _flattened(clip, size, vertices)
    found = np.empty((len(mesh.edges), 2), np.int32)
    normals = np.empty((len(mesh.edges), 2))
    counts = _picture_edges(flat, mesh, found, normals)
    corners = _corners(found[: counts[1]], normals, mesh.weld)
    for s in range(counts[1]):
        for end in range(2):
            v = found[s, end]
            outward = corners[mesh.weld[v]]
            if outward[0] == 0 and outward[1] == 0:
                outward = normals[s]
            for outer in range(2):
                vertex = strips[s, 3 - end if outer else end]
                distance = reach_px if outer else 0.0
                vertex[0] = (flat[v, 0] + distance * outward[0]) / (size[0] / 2)
                vertex[1] = (flat[v, 1] + distance * outward[1]) / (size[1] / 2)
                vertex[2] = flat[v, 2] + BEHIND
                vertex[3:7] = shown[v]
                vertex[7] = distance
    return counts


@jit
def _flattened(clip: Array, size: tuple[int, int], vertices: Array) -> Array:
    """(n, 3) vertices, pixels from the middle of the picture, and depth in clip coordinates."""
    flat = np.empty((len(vertices), 3))
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        depth = clip[3, 0] * x + clip[3, 1] * y + clip[3, 2] * z + clip[3, 3]
        for k in range(3):
            along = clip[k, 0] * x + clip[k, 1] * y + clip[k, 2] * z + clip[k, 3]
            flat[i, k] = along / depth * (size[k] / 2 if k < 2 else 1.0)
    return flat


@jit
def _facing(flat: Array, triangles: VertexIndices) -> Mask:
    """(m,) whether each triangle faces the camera: counter-clockwise where y points up."""
    facing = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ahead_x, ahead_y = flat[b, 0] - flat[a, 0], flat[b, 1] - flat[a, 1]
        facing[t] = ahead_x * (flat[c, 1] - flat[a, 1]) - ahead_y * (flat[c, 0] - flat[a, 0]) < 0
    return facing


@jit
def _picture_edges(
    flat: Array, mesh: EdgeMesh, found: VertexIndices, normals: Array
) -> tuple[int, int]:
    """Find the edges of the picture; returns how many there are outside the mouth, and of all.

    flat: (n, 3), see `_flattened`.
    found: (e, 2) written, their vertices.  normals: (e, 2) written, outwards, of length 1.
    """
    facing = _facing(flat, mesh.triangles)
    outer = count = 0
    for e in range(len(mesh.edges)):
        first, second = mesh.edges[e, 0], mesh.edges[e, 3]
        if facing[first] == (second >= 0 and facing[second]):
            continue
        side = 0 if facing[first] else 3
        a, b = mesh.edges[e, side + 1], mesh.edges[e, side + 2]
        third = mesh.triangles[mesh.edges[e, side]].sum() - a - b
        x, y = flat[a, 1] - flat[b, 1], flat[b, 0] - flat[a, 0]
        length = np.sqrt(x * x + y * y)
        if length == 0:
            continue
        if x * (flat[third, 0] - flat[a, 0]) + y * (flat[third, 1] - flat[a, 1]) > 0:
            length = -length
        found[count] = a, b
        normals[count] = x / length, y / length
        count += 1
        if e < mesh.outside:
            outer = count
    return outer, count


@jit
def _corners(found: VertexIndices, normals: Array, weld: VertexIndices) -> Array:
    """(n, 2) how a welded vertex moves if edges move outwards by 1; 0 where they do not agree.

    found, normals: see `_picture_edges`.
    """
    corners, degrees = np.zeros((len(weld), 2)), np.zeros(len(weld))
    for s in range(len(found)):
        for end in range(2):
            corners[weld[found[s, end]]] += normals[s]
            degrees[weld[found[s, end]]] += 1
    for v in range(len(weld)):
        if degrees[v]:
            square = corners[v, 0] ** 2 + corners[v, 1] ** 2
            agree = square * MITRE**2 > degrees[v] ** 2
            corners[v] *= degrees[v] / square if agree else 0.0
    return corners
