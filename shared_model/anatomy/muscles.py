"""Linear, sphincter and sheet muscles (thesis 2.3.1; Waters 1987; Parke and Waters 1996, ch. 6).

A muscle is data in millimetres, anchored at named anatomical points, so it applies to any head in
the head frame with these landmarks.  Its `displacement` is that of full contraction; a contraction
in [0, 1] scales it linearly (eq. 2.10).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from shared_model.arrays import Array

Points = Mapping[str, Array]
Offset = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Anchor:
    """A position as a landmark (thesis A.1, without its side) and an offset, mm.

    offset_mm: (lateral, up, forward); lateral is away from the midline on the muscle's own side.
    """

    landmark: str
    offset_mm: Offset = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LinearMuscle:
    """Pulls skin from its insertion towards its attachment on the bone.

    attachment, insertion: the ends of the muscle.
    zone_deg: half angle of the cone of influence about the muscle, seen from the attachment.
    start_mm, end_mm: distances from the attachment where the pull is full and where it is zero.
    pull_mm: displacement at full contraction where the pull is full (elasticity times contraction).
    bulge_mm: forward swelling of the tissue between the ends.
    """

    name: str
    attachment: Anchor
    insertion: Anchor
    zone_deg: float
    start_mm: float
    end_mm: float
    pull_mm: float
    bulge_mm: float = 0.0

    def displacement(self, vertices: Array, points: Points, side: str) -> Array:
        """(n, 3) mm of vertices (n, 3) mm at full contraction of the muscle of one side, l or r."""
        origin = anchor_position(self.attachment, points, side)
        axis = _unit(anchor_position(self.insertion, points, side) - origin)
        away = vertices - origin
        distance = np.linalg.norm(away, axis=1)
        cosine = np.clip(away @ axis / np.maximum(distance, 1e-9), -1, 1)
        angular = falloff(np.degrees(np.arccos(cosine)), 0, self.zone_deg)
        radial = np.where(
            distance < self.start_mm,
            np.sin(np.pi / 2 * np.clip(distance / self.start_mm, 0, 1)),
            falloff(distance, self.start_mm, self.end_mm),
        )
        strength = angular * radial
        field = -away / np.maximum(distance, 1e-9)[:, None] * (self.pull_mm * strength)[:, None]
        # The swelling is largest half way to the insertion and vanishes at both ends.
        middle = np.sin(np.pi * np.clip(distance / self.start_mm, 0, 1)) * angular
        field[:, 2] += self.bulge_mm * middle
        return np.asarray(field)


@dataclass(frozen=True, slots=True)
class SphincterMuscle:
    """Draws skin towards a centre within an ellipse in the frontal plane.

    centre: of the ellipse; on the midline a sphincter has no side.
    reach_mm: (horizontal, vertical, depth) semi-axes of the ellipsoid of influence.
    squeeze: (horizontal, vertical) share of the way to the centre at full contraction.
    protrude_mm: forward displacement at the centre.
    """

    name: str
    centre: Anchor
    reach_mm: Offset
    squeeze: tuple[float, float]
    protrude_mm: float = 0.0

    def displacement(self, vertices: Array, points: Points, side: str) -> Array:
        """(n, 3) mm of vertices (n, 3) mm at full contraction."""
        away = vertices - anchor_position(self.centre, points, side)
        strength = falloff(np.linalg.norm(away / np.array(self.reach_mm), axis=1), 0, 1)
        field = np.zeros_like(away)
        field[:, :2] = -away[:, :2] * self.squeeze * strength[:, None]
        field[:, 2] = self.protrude_mm * strength
        return field


@dataclass(frozen=True, slots=True)
class SheetMuscle:
    """A band of parallel fibres that moves the skin over it in one direction.

    centre: position of full pull.  direction: (lateral, up, forward), any length.
    width_mm, height_mm: half width and half heights (above, below), where the pull is zero.
    pull_mm: displacement at full contraction at the centre.
    """

    name: str
    centre: Anchor
    direction: Offset
    width_mm: float
    height_mm: tuple[float, float]
    pull_mm: float

    def displacement(self, vertices: Array, points: Points, side: str) -> Array:
        """(n, 3) mm of vertices (n, 3) mm at full contraction of the muscle of one side."""
        away = vertices - anchor_position(self.centre, points, side)
        above, below = self.height_mm
        vertical = np.where(away[:, 1] > 0, away[:, 1] / above, -away[:, 1] / below)
        strength = falloff(np.hypot(away[:, 0] / self.width_mm, vertical), 0, 1)
        strength *= falloff(np.abs(away[:, 2]), 25, 60)
        pull = _unit(np.array(self.direction)) * self.pull_mm
        return np.asarray(strength[:, None] * (pull if side == "l" else pull * MIRROR))


Muscle = LinearMuscle | SphincterMuscle | SheetMuscle
MIRROR = np.array([-1.0, 1.0, 1.0])


def anchor_position(anchor: Anchor, points: Points, side: str) -> Array:
    """(3,) mm: an anchor on a head with these landmarks.  Raises ValueError if one is missing."""
    for name in (anchor.landmark, f"{anchor.landmark}_{side}"):
        if name in points:
            offset = np.array(anchor.offset_mm)
            return np.asarray(points[name] + (offset if side == "l" else offset * MIRROR))
    raise ValueError(f"landmarks lack {anchor.landmark!r}, which a muscle is anchored at")


def falloff(x: Array, start: float, end: float) -> Array:
    """1 up to `start`, 0 from `end` on, a smooth half cosine between them."""
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip((x - start) / (end - start), 0, 1)))


def ramp(x: Array, start: float, end: float) -> Array:
    """0 up to `start`, 1 from `end` on, a smooth half cosine between them."""
    return np.asarray(1 - falloff(x, start, end))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))
