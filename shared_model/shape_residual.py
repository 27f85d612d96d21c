"""The residual of a person's shape after the AAUs: displacements of a few dozen control points.

Residual displacement = residual_basis(head).T @ control, control (k, 3) mm, interpolated by radial
basis functions.  Both ends compute the basis by one linear solve on the generic head.
"""

from functools import cache

import numpy as np

from shared_model.aperture_sheets import head_with_aperture_sheets, rim_weights
from shared_model.arrays import Array, Integers, VertexIndices
from shared_model.mesh import PARTS, Head, generic_head
from shared_model.parameters import EAU_INDEX
from shared_model.surround import head_with_surround, surround_anchors

# Points of the 468-point landmark network, the midline and the subject's right; lefts are mirrored.
CONTOUR = (
    10,
    338,
    332,
    251,
    356,
    454,
    361,
    397,
    379,
    400,
    152,
    176,
    150,
    172,
    132,
    234,
    127,
    21,
    103,
    109,
)
BROWS = (70, 105, 107, 336, 334, 300)
LIDS = (33, 159, 133, 145, 263, 386, 362, 374)
NOSE = (168, 6, 4, 2, 98, 327, 129, 358)
LIPS = (61, 291, 0, 17, 40, 270, 91, 321, 13, 14)
CHEEKS = (50, 280, 205, 425, 117, 346, 18, 151)
NETWORK_POINTS = CONTOUR + BROWS + LIDS + NOSE + LIPS + CHEEKS

# Landmarks without displacement: the residual falls off towards them.
FIXED_LANDMARKS = ("v", "op", "po_l", "po_r", "eu_l", "eu_r")
# Parts that move rigidly, with the mean of these landmarks.
RIGID_SUPPORTS = {
    "eye_left": ("en_l", "ex_l", "ps_l", "pi_l"),
    "eye_right": ("en_r", "ex_r", "ps_r", "pi_r"),
    "teeth_upper": ("sn", "ls"),
    "teeth_lower": ("li", "sl"),
    "tongue": ("li", "sl"),
}
# Shape parameter of the multiquadric basis functions, mm.
MULTIQUADRIC_MM = 10.0
# Distance between the lips for the basis functions, mm.
LIP_GAP_MM = 45.0


def control_points(head: Head) -> VertexIndices:
    """(k,) the skin vertices nearest to `NETWORK_POINTS`, each once."""
    triangles = head.network_triangles[list(NETWORK_POINTS)]
    known = triangles >= 0
    corners = head.triangles[triangles[known]]
    best = head.network_weights[list(NETWORK_POINTS)][known].argmax(1)
    vertices = corners[np.arange(len(corners)), best]
    return np.array(list(dict.fromkeys(vertices.tolist())), dtype=np.int32)


def fixed_points(head: Head) -> Integers:
    """(f,) vertices without displacement: landmarks, and a coarse set of neck and back."""
    landmarks = [head.landmarks[name] for name in FIXED_LANDMARKS]
    return np.concatenate([landmarks, _fixed_back_vertices(head)])


def residual_basis(head: Head) -> Array:
    """(k, n) share of each control point in the displacement of each vertex.

    The displacement of a control point is that of its vertex and is zero at the other control
    points.  Eyeballs move rigidly with the middle of their eyelids, teeth and tongue with the lips.
    """
    if head is generic_head():
        return _generic_basis()
    if head is head_with_surround():
        return _surrounded_basis()
    return _sheeted_basis() if head is head_with_aperture_sheets() else _basis(head)


@cache
def _generic_basis() -> Array:
    return _basis(generic_head())


@cache
def _sheeted_basis() -> Array:
    basis = _generic_basis()
    return np.concatenate([basis, basis @ rim_weights(generic_head()).T], axis=1)


@cache
def _surrounded_basis() -> Array:
    basis = _sheeted_basis()
    return np.concatenate([basis, basis[:, surround_anchors(head_with_aperture_sheets())]], axis=1)


def _basis(head: Head) -> Array:
    positions = _lip_separated(head)
    control = control_points(head)
    k = len(control)
    centres = positions[np.concatenate([control, fixed_points(head)])]
    kernel = _multiquadric(centres, centres)
    size = len(centres)
    system = np.zeros((size + 1, size + 1))
    system[:size, :size] = kernel
    system[:size, size] = system[size, :size] = 1
    weights = np.linalg.solve(system, np.eye(size + 1)[:, :k])
    design = np.concatenate([_multiquadric(positions, centres), np.ones((len(positions), 1))], 1)
    basis = (design @ weights).T
    return _with_rigid_parts(head, basis)


def _lip_separated(head: Head) -> Array:
    """(n, 4) mm: the vertices with a fourth coordinate that separates the lips.

    It is proportional to the jaw's field, which is discontinuous between the lips alone.
    """
    jaw = np.linalg.norm(head.eau_up[EAU_INDEX["jaw_drop"]], axis=1)
    relative = np.clip(jaw / jaw[head.landmarks["li"]], 0, 1)
    return np.concatenate([head.vertices, LIP_GAP_MM * relative[:, None]], 1)


def _multiquadric(a: Array, b: Array) -> Array:
    square = np.zeros((len(a), len(b)))
    for first, second in zip(a.T, b.T, strict=True):
        square += np.subtract.outer(first, second) ** 2
    return np.asarray(-np.sqrt(square + MULTIQUADRIC_MM**2))


def _fixed_back_vertices(head: Head) -> Integers:
    """A few skin vertices on the back of the head and the neck, one for each cell of a grid."""
    tragion = head.vertices[head.landmarks["t_l"]]
    skin = head.parts == PARTS.index("skin")
    back = np.flatnonzero(skin & (head.vertices[:, 2] < tragion[2] - 25))
    cells: dict[tuple[float, ...], int] = {}
    for index in back.tolist():
        cells.setdefault(tuple(np.round(head.vertices[index] / 45).tolist()), index)
    return np.array(sorted(cells.values()), dtype=np.int64)


def _with_rigid_parts(head: Head, basis: Array) -> Array:
    """The basis with eyeballs, teeth and tongue moving rigidly with the skin around them."""
    for name, landmarks in RIGID_SUPPORTS.items():
        mean = basis[:, [head.landmarks[landmark] for landmark in landmarks]].mean(1)
        basis[:, head.parts == PARTS.index(name)] = mean[:, None]
    return basis
