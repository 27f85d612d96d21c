"""The displacement fields of the Anthropometric Action Units (thesis 2.3.2 and A.1).

Each AAU displaces along one axis of the head frame only, and changes its own measurement.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from shared_model.anatomy.anthropometry import MEASUREMENTS, X, Y, Z, distance
from shared_model.anatomy.muscles import falloff, ramp
from shared_model.arrays import Array
from shared_model.curves import smooth_curve
from shared_model.mesh import PARTS
from shared_model.parameters import AAUS


def aau_fields(vertices: Array, parts: NDArray[np.integer], landmarks: Mapping[str, int]) -> Array:
    """Displacement fields (len(AAUS), n, 3) float64, mm, of the AAUs at +1.

    vertices: (n, 3) mm, head frame, neutral.  parts: (n,) index into `PARTS`.
    Each field, added to `vertices`, raises its own measurement by two standard deviations.
    """
    points = {name: vertices[index] for name, index in landmarks.items()}
    fields = np.zeros((len(AAUS), *vertices.shape))
    for field, measurement in zip(fields, MEASUREMENTS, strict=True):
        axis, shape = SHAPES[measurement.name]
        field[:, axis] = _with_rigid_parts(shape, vertices, parts, points)
        moved = {name: vertices[index] + field[index] for name, index in landmarks.items()}
        gain = distance(measurement, moved) - distance(measurement, points)
        field *= 2 * measurement.deviation_mm / gain
    return fields


Shape = Callable[[Array, Mapping[str, Array]], Array]


def _with_rigid_parts(
    shape: Shape, vertices: Array, parts: NDArray[np.integer], points: Mapping[str, Array]
) -> Array:
    """(n,) displacement; eyeballs, teeth and tongue move rigidly with a point near them."""
    amount = shape(vertices, points)
    supports = {
        "eye_left": (points["en_l"] + points["ex_l"]) / 2,
        "eye_right": (points["en_r"] + points["ex_r"]) / 2,
        "teeth_upper": points["sto_upper"],
        "teeth_lower": points["sto_lower"],
        "tongue": points["sto_lower"],
    }
    for name, support in supports.items():
        amount[parts == PARTS.index(name)] = shape(support[None], points)[0]
    return amount


def _smooth(y: Array, knots: Mapping[float, float]) -> Array:
    heights = sorted(knots)
    return smooth_curve(y, heights, [knots[height] for height in heights])


def _profile(vertices: Array, points: Mapping[str, Array], knots: Mapping[str, float]) -> Array:
    """Vertical displacement given at midline landmarks; none behind the face.

    At the cheeks it is interpolated smoothly between the eyes' level and the chin.
    """
    heights = {float(points[name][Y]): value for name, value in knots.items()}
    y = vertices[:, Y]
    level = {name: float(points[name][Y]) for name in ("on", "pi_l", "gn")}
    upper = {height: value for height, value in heights.items() if height >= level["on"]}
    cheek = _smooth(y, {**upper, level["pi_l"]: 0.0, level["gn"]: knots["gn"]})
    corner = points["ch_l"][X]
    cheek_weight = ramp(np.abs(vertices[:, X]), corner, 2.2 * corner)
    middle = _smooth(y, heights)
    return np.asarray((middle + cheek_weight * (cheek - middle)) * ramp(vertices[:, Z], -50, 40))


def _cranial_width(vertices: Array, points: Mapping[str, Array]) -> Array:
    x, y = vertices[:, X], vertices[:, Y]
    go, t = points["go_l"], points["t_l"]
    return np.asarray(np.sign(x) * ramp(np.abs(x), 0.42 * t[X], t[X]) * ramp(y, go[Y], t[Y] - 2))


def _facial_height(vertices: Array, points: Mapping[str, Array]) -> Array:
    knots = {
        "v": 0.9,
        "tr": 0.62,
        "on": 0.0,
        "sn": 0.0,
        "sto_lower": -0.07,
        "sl": -0.36,
        "gn": -0.38,
    }
    return _profile(vertices, points, knots)


def _facial_depth(vertices: Array, points: Mapping[str, Array]) -> Array:
    return ramp(vertices[:, Z], points["t_l"][Z], points["or_l"][Z])


def _mandible_width(vertices: Array, points: Mapping[str, Array]) -> Array:
    x, go = np.abs(vertices[:, X]), points["go_l"]
    height = falloff(np.abs(vertices[:, Y] - go[Y]), 4, 50)
    along = falloff(np.abs(vertices[:, Z] - go[Z]), 12, 62)
    return np.asarray(np.sign(vertices[:, X]) * ramp(x, 0.45 * go[X], go[X]) * height * along)


def _chin_height(vertices: Array, points: Mapping[str, Array]) -> Array:
    # The hairline moves by as much as the chin, so that the height of the face is unchanged.
    knots = {"tr": -0.6, "on": 0.0, "sto_lower": 0.0, "sl": 0.4, "gn": -0.6}
    return _profile(vertices, points, knots)


def _nose_height(vertices: Array, points: Mapping[str, Array]) -> Array:
    down = _profile(
        vertices, points, {"tr": -0.65, "on": 0.0, "n": 0.0, "prn": -0.15, "sn": -0.65, "gn": -0.65}
    )
    return down + 0.35 * _nose_root(vertices, points)


def _nose_bridge_length(vertices: Array, points: Mapping[str, Array]) -> Array:
    prn, sn = points["prn"], points["sn"]
    below = prn[Y] - sn[Y]
    away = vertices - prn
    vertical = np.where(away[:, Y] > 0, away[:, Y] / (2.8 * below), -away[:, Y] / below)
    tip = falloff(np.sqrt((away[:, X] / 28) ** 2 + vertical**2 + (away[:, Z] / 34) ** 2), 0.1, 1)
    return 0.25 * _nose_root(vertices, points) - 0.75 * tip


def _nose_root(vertices: Array, points: Mapping[str, Array]) -> Array:
    n = points["n"]
    root = falloff(np.hypot(vertices[:, X] / 14, (vertices[:, Y] - n[Y]) / 22), 0, 1)
    return np.asarray(root * ramp(vertices[:, Z], 60, 80))


def _nose_width(vertices: Array, points: Mapping[str, Array]) -> Array:
    return _widened(vertices, points["al_l"], (14, 26), (7, 22), 26)


def _mouth_width(vertices: Array, points: Mapping[str, Array]) -> Array:
    return _widened(vertices, points["ch_l"], (22, 40), (8, 26), 45)


def _widened(
    vertices: Array,
    side: Array,
    lateral: tuple[float, float],
    vertical: tuple[float, float],
    depth: float,
) -> Array:
    """In proportion to x up to the point `side`, then fading.

    lateral: mm in depth without falloff, and mm beyond `side` where the field is zero.
    vertical: mm above and below without falloff, and where it is zero.  depth: mm where it is zero.
    """
    x = vertices[:, X]
    share = np.clip(x / side[X], -1, 1) * falloff(np.abs(x) - side[X], 0, lateral[1])
    share *= falloff(np.abs(vertices[:, Y] - side[Y]), *vertical)
    return np.asarray(share * falloff(np.abs(vertices[:, Z] - side[Z]), lateral[0], depth))


def _mouth_shift(vertices: Array, points: Mapping[str, Array]) -> Array:
    knots = {
        "tr": -0.5,
        "on": 0.0,
        "sn": 0.0,
        "sto_upper": -1.0,
        "li": -0.9,
        "sl": -0.5,
        "gn": -0.5,
    }
    return _profile(vertices, points, knots)


def _eyebrow_height(vertices: Array, points: Mapping[str, Array]) -> Array:
    sci, ps, tr = points["sci_l"], points["ps_l"], points["tr"]
    band = _smooth(
        vertices[:, Y],
        {
            float(ps[Y]) + 2: 0.0,
            float(sci[Y]) - 1: 1.0,
            float(sci[Y]) + 5: 1.0,
            float(tr[Y]) - 5: 0.0,
        },
    )
    return np.asarray(band * ramp(vertices[:, Z], 30, 65))


SHAPES: Mapping[str, tuple[int, Shape]] = {
    "cranial_width": (X, _cranial_width),
    "facial_height": (Y, _facial_height),
    "facial_depth": (Z, _facial_depth),
    "mandible_width": (X, _mandible_width),
    "chin_height": (Y, _chin_height),
    "nose_height": (Y, _nose_height),
    "nose_bridge_length": (Y, _nose_bridge_length),
    "nose_width": (X, _nose_width),
    "mouth_shift": (Y, _mouth_shift),
    "mouth_width": (X, _mouth_width),
    "eyebrow_height": (Y, _eyebrow_height),
}
