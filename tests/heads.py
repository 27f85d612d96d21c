"""An ellipsoid as a head, for tests that need a mesh without anatomy; projected landmarks."""

import numpy as np

from shared_model.animate import Face, Identity
from shared_model.arrays import Array
from shared_model.geometry import Camera, matrix_from_quaternion, pixel_from_head
from shared_model.mesh import PARTS, Head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, FaceParameters

RADII_MM = np.array([75.0, 110.0, 95.0])


def sphere(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit sphere about y with poles: vertices (n, 3) and outward triangles (m, 3)."""
    polar = np.linspace(0, np.pi, rows + 1)[1:-1, None]
    around = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    ring = np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)
        ),
        -1,
    )
    vertices = np.concatenate([[[0, 1, 0]], ring.reshape(-1, 3), [[0, -1, 0]]])
    triangles = []
    last = len(vertices) - 1
    for j in range(columns):
        k = (j + 1) % columns
        triangles.append((0, 1 + j, 1 + k))
        triangles.append((last, last - columns + k, last - columns + j))
        for i in range(rows - 2):
            a, b = 1 + i * columns + j, 1 + i * columns + k
            triangles += [(a, a + columns, b), (b, a + columns, b + columns)]
    return vertices, np.array(triangles, dtype=np.int32)


def synthetic_head(rows: int = 24, columns: int = 32) -> Head:
    """An ellipsoid of 150 x 220 x 190 mm with two eyeballs, an opaque front and a fading rim.

    Jaw drop lowers the lower front by 20 mm; every AAU and every other EAU does nothing.
    """
    unit, triangles = sphere(rows, columns)
    parts = [np.full(len(unit), PARTS.index("skin"))]
    vertices, faces = [unit * RADII_MM], [triangles]
    for part, x_mm in (("eye_left", 31.0), ("eye_right", -31.0)):
        ball, ball_triangles = sphere(8, 12)
        faces.append(ball_triangles + sum(map(len, vertices)))
        vertices.append(ball * 12 + (x_mm, 20.0, 78.0))
        parts.append(np.full(len(ball), PARTS.index(part)))
    points = np.concatenate(vertices)
    eau = np.zeros((len(EAUS), len(points), 3))
    low = np.clip(-points[:, 1] / RADII_MM[1], 0, 1) * (points[:, 2] > 0)
    eau[EAU_INDEX["jaw_drop"], :, 1] = -20 * low
    return Head(
        vertices=points,
        triangles=np.concatenate(faces).astype(np.int32),
        texture_coordinates=np.stack([0.5 + points[:, 0] / 200, 0.5 - points[:, 1] / 260], axis=1),
        parts=np.concatenate(parts).astype(np.uint8),
        opacity=np.clip((points[:, 2] - 10) / 30, 0, 1),
        landmarks={
            "gn": int(np.argmin(points[:, 1])),
            "sto_upper": _nearest(points, (0.0, -45.0, 85.0)),
            "sto_lower": _nearest(points, (0.0, -60.0, 80.0)),
        },
        network_triangles=np.full(468, -1, dtype=np.int32),
        network_weights=np.zeros((468, 3)),
        eau_up=eau,
        eau_down=np.zeros_like(eau),
        aau=np.zeros((len(AAUS), len(points), 3)),
    )


def _nearest(points: np.ndarray, place: tuple[float, float, float]) -> int:
    return int(np.argmin(np.linalg.norm(points - np.array(place), axis=1)))


def seen_points(
    head: Head,
    camera: Camera,
    face: FaceParameters,
    aau: Array | None = None,
    noise_px: float = 0.0,
) -> Array:
    """(468, 3) landmarks as the network gives them, px; depth is relative to its mean."""
    identity = Identity(np.zeros(len(AAUS)) if aau is None else aau, np.zeros_like(head.vertices))
    vertices = Face(head, identity).animate(face.eau)
    known = head.network_triangles >= 0
    corners = head.triangles[head.network_triangles[known]]
    points = np.einsum("mc,mcd->md", head.network_weights[known], vertices[corners])
    turned = points @ matrix_from_quaternion(face.pose.rotation).T
    depth = turned[:, 2] * camera.focal_px / face.pose.translation_mm[2]
    found = np.zeros((468, 3))
    found[known, :2] = pixel_from_head(camera, face.pose, points)
    found[known, 2] = depth - depth.mean()
    noise = np.random.default_rng(4).normal(size=found.shape)
    return np.asarray(found + noise_px * noise)
