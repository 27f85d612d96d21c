"""Anthropometric Action Units: eleven measurements of the face (thesis 2.3.2 and A.1).

+-1 is +-2 standard deviations of adults, women and men together.  Every measurement is an axial
distance (Farkas' second kind) along its AAU's axis, except the nose's bridge, a shortest distance
(his first kind).  The displacement fields are made by `assets/head_asset/aau_fields.py`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from shared_model.arrays import Array

X, Y, Z = range(3)


@dataclass(frozen=True, slots=True)
class Measurement:
    """One AAU's measurement and how it varies between adults.

    ends: the two landmarks, without sides; equal ends are measured from left to right.
    axis: 0, 1, 2 for an axial distance along x, y, z; None for the shortest distance.
    male, female: (mean, standard deviation), mm.
    source: where the figures come from.
    """

    name: str
    ends: tuple[str, str]
    axis: int | None
    male: tuple[float, float]
    female: tuple[float, float]
    source: str

    @property
    def mean_mm(self) -> float:
        """Mean of women and men, in equal parts."""
        return (self.male[0] + self.female[0]) / 2

    @property
    def deviation_mm(self) -> float:
        """Standard deviation of women and men together."""
        within = (self.male[1] ** 2 + self.female[1] ** 2) / 2
        return float(np.sqrt(within + ((self.male[0] - self.female[0]) / 2) ** 2))


_TABLE = "Farkas et al. 2005 (North American white, 18-30 years), after Farkas 1994"
_NEAR = "approximate, near Farkas 1994 (North American white, young adults)"
_OWN = "no published value known to us; our estimate"

MEASUREMENTS = (
    Measurement("cranial_width", ("t", "t"), X, (143.0, 5.5), (133.0, 5.0), _NEAR),
    Measurement("facial_height", ("tr", "gn"), Y, (187.0, 9.0), (173.0, 8.0), _NEAR),
    Measurement("facial_depth", ("or", "t"), Z, (81.0, 4.0), (77.0, 3.5), _OWN),
    Measurement("mandible_width", ("go", "go"), X, (97.1, 5.8), (91.1, 5.9), _TABLE),
    Measurement("chin_height", ("sl", "gn"), Y, (31.0, 2.8), (26.0, 2.5), _NEAR),
    Measurement("nose_height", ("n", "sn"), Y, (54.8, 3.3), (50.6, 3.1), _TABLE),
    Measurement("nose_bridge_length", ("n", "prn"), None, (50.0, 3.6), (44.7, 3.4), _NEAR),
    Measurement("nose_width", ("al", "al"), X, (34.9, 2.1), (31.4, 2.0), _TABLE),
    Measurement("mouth_shift", ("sn", "sto"), Y, (22.3, 2.1), (20.1, 2.0), _NEAR),
    Measurement("mouth_width", ("ch", "ch"), X, (54.5, 3.0), (50.2, 3.5), _TABLE),
    Measurement("eyebrow_height", ("sci", "ex"), Y, (21.0, 2.6), (22.5, 2.6), _OWN),
)


def measure(vertices: Array, landmarks: Mapping[str, int]) -> dict[str, float]:
    """The eleven measurements, mm, of a head: vertices (n, 3) mm, landmark name -> vertex."""
    points = {name: vertices[index] for name, index in landmarks.items()}
    return {m.name: distance(m, points) for m in MEASUREMENTS}


def distance(measurement: Measurement, points: Mapping[str, Array]) -> float:
    """A measurement, mm, of landmarks: name -> (3,) mm."""
    first, second = measurement.ends
    if first == second:
        pairs = [(f"{first}_l", f"{first}_r")]
    elif f"{second}_l" in points:
        pairs = [(f"{first}_{side}", f"{second}_{side}") for side in "lr"]
    else:
        pairs = [(first, second)]
    differences = [points[a] - points[b] for a, b in pairs]
    if measurement.axis is None:
        return float(np.mean([np.linalg.norm(d) for d in differences]))
    return float(np.mean([abs(d[measurement.axis]) for d in differences]))
