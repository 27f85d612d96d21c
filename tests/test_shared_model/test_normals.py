"""Normals point out of the mesh."""

import numpy as np
from heads import RADII_MM, synthetic_head

from shared_model.normals import vertex_normals


def test_normals_of_an_ellipsoid_point_outwards() -> None:
    head = synthetic_head()
    skin = head.parts == 0
    normals = vertex_normals(head.vertices, head.triangles)[skin]
    outward = head.vertices[skin] / RADII_MM**2
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert (normals * outward).sum(axis=1).min() > 0.98


def test_vertices_of_no_triangle_have_no_normal() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    normals = vertex_normals(vertices, np.array([[0, 1, 2]], dtype=np.int32))
    np.testing.assert_array_equal(normals, [[0, 0, 1]] * 3 + [[0, 0, 0]])
