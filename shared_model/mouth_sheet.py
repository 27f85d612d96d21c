"""The head with a sheet between the lips in place of teeth, tongue and mouth bag.

The default profile paints the inside of the mouth by its appearance modes; for that a sheet that
hangs between the inner rims of the lips serves better than the generic mouth, since every texel of
it shows the same place between the lips in every frame.  Closed lips fold it to nothing.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from shared_model.mesh import PARTS, Head, generic_head

Array = NDArray[np.float64]

# Inner rims of the lips among the network's points, from the subject's right corner to the left.
UPPER_RIM = (78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308)
LOWER_RIM = (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308)
# Where the sheet lies in the atlas, in place of the islands of the parts it replaces: u, v ranges.
ISLAND = ((0.06, 0.94), (0.9, 0.99))
# The sheet hangs this far behind the rims, so that the lips' own edges are in front, mm.
BEHIND_MM = 1.5
# The face keeps its texture further into the hair than it needs to in the thesis profile.
OPACITY_GAIN = 2.5


@cache
def mouth_sheet_head() -> Head:
    """The generic head with a mouth sheet; its vertices are followed by those of the two rims."""
    head = generic_head()
    carry = rim_weights(head)
    count = len(head.vertices)
    inside = [PARTS.index(name) for name in ("teeth_upper", "teeth_lower", "tongue", "mouth")]
    outer = head.triangles[~np.isin(head.parts[head.triangles[:, 0]], inside)]
    behind = np.array([0.0, 0.0, -BEHIND_MM])

    def extended(values: Array) -> Array:
        return np.concatenate([values, carry @ values], axis=-2)

    vertices = extended(head.vertices)
    vertices[count:] += behind
    return Head(
        vertices=vertices,
        triangles=np.concatenate([outer, count + _strip(len(UPPER_RIM))]).astype(np.int32),
        texture_coordinates=np.concatenate([head.texture_coordinates, _island()]),
        parts=np.append(head.parts, np.full(len(carry), PARTS.index("mouth"), np.uint8)),
        opacity=np.append(np.minimum(OPACITY_GAIN * head.opacity, 1), np.ones(len(carry))),
        landmarks=head.landmarks,
        network_triangles=_renumbered(head),
        network_weights=head.network_weights,
        eau_up=extended(head.eau_up),
        eau_down=extended(head.eau_down),
        aau=extended(head.aau),
    )


def rim_weights(head: Head) -> Array:
    """(r, n) each rim vertex as a weighted mean of the head's vertices, upper rim first."""
    points = [*UPPER_RIM, *LOWER_RIM]
    weights = np.zeros((len(points), len(head.vertices)))
    for row, point in enumerate(points):
        corners = head.triangles[head.network_triangles[point]]
        weights[row, corners] = head.network_weights[point]
    return weights


def _renumbered(head: Head) -> NDArray[np.int32]:
    """The network's points keep their triangles, whose numbers change as others go."""
    inside = head.parts[head.triangles[:, 0]] > PARTS.index("eye_right")
    number = np.cumsum(~inside) - 1
    found = np.where(inside[head.network_triangles], -1, number[head.network_triangles])
    return np.where(head.network_triangles < 0, -1, found).astype(np.int32)


def _strip(count: int) -> NDArray[np.int32]:
    """Triangles between an upper row 0..count-1 and the lower row after it, seen from outside."""
    a = np.arange(count - 1)
    upper, lower = a, a + count
    first = np.stack([upper, lower, lower + 1], 1)
    second = np.stack([upper, lower + 1, upper + 1], 1)
    return np.concatenate([first, second]).astype(np.int32)


def _island() -> Array:
    (left, right), (top, bottom) = ISLAND
    u = np.linspace(left, right, len(UPPER_RIM))
    rows = [np.stack([u, np.full_like(u, v)], 1) for v in (top, bottom)]
    return np.concatenate(rows)
