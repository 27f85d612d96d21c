"""Jaw, eyelids and eyes: the actuators that are rotations instead of muscle contractions.

The field of each is the chord from rest to full rotation, so it is linear in the actuator
(eq. 2.10).  A chord lies inside its arc: a half-closed eyelid is 0.6 mm too deep, less than its
thickness, so the eyeball stays covered; a half-turned eyeball is 0.5 mm too flat.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.anatomy.mouth import MouthLine
from shared_model.anatomy.muscles import Points, falloff, ramp
from shared_model.arrays import Array, Mask
from shared_model.geometry import matrix_from_quaternion, quaternion_from_vector
from shared_model.mesh import PARTS

Parts = NDArray[np.integer]

# Skin of the tragus to the middle of the condyle: forward and down (tissue and joint), mm.
CONDYLE_FROM_TRAGION = np.array([0.0, -4.0, 12.0])
JAW_DEG = 17.0
# The condyles slide down and forward along the eminence as the mouth opens.
JAW_SLIDE_MM = np.array([0.0, -2.0, 5.0])
# Motion of the tongue at full jaw drop, in addition to the jaw's: into the floor of the mouth.
TONGUE_MM = np.array([0.0, -14.0, -10.0])
# Share of the jaw's motion at the corners of the mouth.
CORNER_SHARE = 0.5
CORNER_NARROWING_MM = 3.0
GAZE_DEG = 30.0
# Reach of the skin that moves with an eyelid, from its margin, degrees about the eye's centre.
UPPER_EYELID_DEG = 36.0
# Exponents of the lid margins' arch.
INNER_CANTHUS, OUTER_CANTHUS = 1.1, 0.8
LOWER_EYELID_DEG = 28.0


def _in_part(parts: Parts, *names: str) -> Mask:
    return np.isin(parts, [PARTS.index(name) for name in names])


def _rotation_chord(vertices: Array, centre: Array, axis: Array, degrees: float) -> Array:
    """(n, 3) chord of turning vertices about an axis through `centre`."""
    matrix = matrix_from_quaternion(quaternion_from_vector(axis * np.radians(degrees)))
    return np.asarray((vertices - centre) @ (matrix - np.eye(3)).T)


def jaw_weight(vertices: Array, parts: Parts, line: MouthLine) -> Array:
    """(n,) share of the jaw's rotation each vertex takes: 1 on the mandible, 0 on the skull.

    Along the line between the lips it jumps from upper to lower lip; at the corners both agree;
    above and below the corners it fades over the cheek, and towards the ramus and the neck.
    """
    upper = CORNER_SHARE * line.along**2.5 * falloff(line.above, 0, 38)
    lower = 1 - (1 - CORNER_SHARE) * line.along**3 * falloff(-line.above, 0, 26)
    behind = ramp(vertices[:, 2], -15, 42)
    weight = (line.lower * lower + (1 - line.lower) * upper) * behind
    weight[_in_part(parts, "teeth_lower", "tongue")] = 1.0
    weight[_in_part(parts, "teeth_upper", "eye_left", "eye_right")] = 0.0
    return np.asarray(weight)


def jaw_field(vertices: Array, parts: Parts, points: Points, line: MouthLine) -> Array:
    """(n, 3) mm at full jaw drop: the mandible turned by `JAW_DEG` about the condyles."""
    condyle = (points["t_l"] + points["t_r"]) / 2 + CONDYLE_FROM_TRAGION
    weight = jaw_weight(vertices, parts, line)
    turned = _rotation_chord(vertices, condyle, np.array([1.0, 0.0, 0.0]), JAW_DEG)
    field = weight[:, None] * (turned + JAW_SLIDE_MM)
    field[_in_part(parts, "tongue")] += TONGUE_MM
    return np.asarray(field + _narrowing(vertices, parts, points))


def _narrowing(vertices: Array, parts: Parts, points: Points) -> Array:
    """(n, 3) mm: the corners of the mouth move inwards as the lips part."""
    corner = points["ch_l"]
    away = np.stack([np.abs(vertices[:, 0]) - corner[0], vertices[:, 1] - corner[1]])
    weight = falloff(np.hypot(*away), 0, 30) * _in_part(parts, "skin", "mouth")
    weight *= ramp(np.abs(vertices[:, 0]), 0, corner[0]) * ramp(vertices[:, 2], 30, 60)
    field = np.zeros_like(vertices)
    field[:, 0] = -np.sign(vertices[:, 0]) * CORNER_NARROWING_MM * weight
    return field


@dataclass(frozen=True, slots=True)
class Eye:
    """centre: (3,) mm.  radius: mm, of the eyeball.  side: l or r."""

    centre: Array
    radius: float
    side: str


def eye(vertices: Array, parts: Parts, side: str) -> Eye:
    """The sphere through an eyeball's vertices (least squares)."""
    ball = vertices[_in_part(parts, "eye_left" if side == "l" else "eye_right")]
    design = np.concatenate([2 * ball, np.ones((len(ball), 1))], 1)
    solution = np.linalg.lstsq(design, (ball**2).sum(1), rcond=None)[0]
    centre = solution[:3]
    return Eye(centre, float(np.sqrt(solution[3] + centre @ centre)), side)


def gaze_field(vertices: Array, parts: Parts, horizontal: float, vertical: float) -> Array:
    """(n, 3) mm: both eyeballs turned by shares of `GAZE_DEG` to the subject's left and up."""
    axis = np.array([-vertical, horizontal, 0.0])
    field = np.zeros_like(vertices)
    for side, name in (("l", "eye_left"), ("r", "eye_right")):
        ball = _in_part(parts, name)
        field[ball] = _rotation_chord(
            vertices[ball], eye(vertices, parts, side).centre, axis, GAZE_DEG
        )
    return field


@dataclass(frozen=True, slots=True)
class EyelidCoordinates:
    """Vertices in polar coordinates about an eye's horizontal axis, with the eyelid margins.

    elevation: (n,) degrees.  radius: (n,) mm from the axis.
    upper, lower: (n,) degrees, the margins of the open eyelids at the x of each vertex.
    weight: (n,) 1 at the eyelids, 0 far from the eye and behind it.
    """

    elevation: Array
    radius: Array
    upper: Array
    lower: Array
    weight: Array


def eyelid_coordinates(
    vertices: Array, parts: Parts, points: Points, ball: Eye
) -> EyelidCoordinates:
    """The vertices relative to the opening of one eye."""
    away = vertices - ball.centre
    radius = np.maximum(np.hypot(away[:, 1], away[:, 2]), ball.radius / 2)
    elevation = np.degrees(np.arctan2(away[:, 1], np.maximum(away[:, 2], 1e-6)))
    upper, lower = (
        np.degrees(
            np.arcsin(np.clip(_margin(vertices[:, 0], points, ball, middle) / radius, -0.9, 0.9))
        )
        for middle in ("ps", "pi")
    )
    skin = _in_part(parts, "skin") & (away[:, 2] > 0)
    weight = skin * falloff(np.linalg.norm(away, axis=1), 1.3 * ball.radius, 1.9 * ball.radius)
    return EyelidCoordinates(elevation, radius, upper, lower, weight)


def _margin(x: Array, points: Points, ball: Eye, middle: str) -> Array:
    """(n,) height of an eyelid margin at `x` (n,), mm above the eye's centre: an arch."""
    inner, outer, top = (points[f"{name}_{ball.side}"] for name in ("en", "ex", middle))
    s = np.clip((x - inner[0]) / (outer[0] - inner[0]), 0, 1)
    m = (top[0] - inner[0]) / (outer[0] - inner[0])
    height = (top[1] - inner[1] - m * (outer[1] - inner[1])) / _arch(m)
    return np.asarray(inner[1] + s * (outer[1] - inner[1]) + height * _arch(s) - ball.centre[1])


def _arch(s: Array) -> Array:
    """Height of the arch, narrow at the inner canthus (s = 0), blunt at the outer one (s = 1)."""
    return np.asarray((1 - (2 * s - 1) ** 2) ** np.where(s < 0.5, INNER_CANTHUS, OUTER_CANTHUS))


def eyelid_field(
    vertices: Array, parts: Parts, points: Points, side: str, upper: float, lower: float
) -> Array:
    """(n, 3) mm: the eyelids of one eye slide over the eyeball.

    upper: downward motion of the upper margin, lower: upward motion of the lower one, relative to
    the opening (1 and 0 close it).  The motion falls off from the margins to brow and cheek.
    """
    ball = eye(vertices, parts, side)
    coordinates = eyelid_coordinates(vertices, parts, points, ball)
    opening = np.maximum(coordinates.upper - coordinates.lower, 0)
    above = coordinates.elevation > (coordinates.upper + coordinates.lower) / 2
    down = falloff(coordinates.elevation - coordinates.upper, 2, UPPER_EYELID_DEG) * upper
    up = falloff(coordinates.lower - coordinates.elevation, 2, LOWER_EYELID_DEG) * lower
    turn = np.where(above, -down, up) * opening * coordinates.weight
    angle = np.radians(coordinates.elevation)
    target = angle + np.radians(turn)
    field = np.zeros_like(vertices)
    field[:, 1] = coordinates.radius * (np.sin(target) - np.sin(angle))
    field[:, 2] = coordinates.radius * (np.cos(target) - np.cos(angle))
    field[coordinates.weight == 0] = 0.0
    return field
