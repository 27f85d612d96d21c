"""Points of rate and quality, curves through them, and where two curves cross."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from shared_model.arrays import Array

# The lengths of a call at which rates are compared, s; 0: what comes after the start.
DURATIONS_S = (5.0, 10.0, 60.0, 600.0, 0.0)
# Measures by which codecs are compared.
MEASURES = ("face_psnr_db", "face_ssimulacra2", "full_psnr_db", "picture_ssimulacra2")
# Rates at which it is looked which curve is above, per decade.
STEPS_PER_DECADE = 100


@dataclass(frozen=True, slots=True)
class Point:
    """One setting of one codec on one clip.

    label: the setting, for people.  setting: the same for programs.
    start_bytes: before the first picture.  steady_bps: bits a second after that.
    figures: what was measured, by name.
    """

    label: str
    start_bytes: int
    steady_bps: float
    figures: dict[str, Any] = field(default_factory=dict)
    setting: dict[str, Any] = field(default_factory=dict)

    def total_bps(self, duration_s: float) -> float:
        """Bits a second of a call of this length, its start included; 0 s: without it."""
        return self.steady_bps + (8 * self.start_bytes / duration_s if duration_s else 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """The best that a codec does at each rate: points of which none has more bits and less quality.

    rates: bits a second, rising.  qualities: of one measure, rising.
    """

    rates: Array
    qualities: Array

    def quality_at(self, rate: float | Array) -> Array:
        """The quality at a rate: that of the points, between them by the logarithm of the rate.

        Below the lowest point it is -inf; above the highest that of the highest.
        """
        if not len(self.rates):
            return np.full(np.shape(rate), -np.inf)
        at = np.interp(np.log(rate), np.log(self.rates), self.qualities, left=-np.inf)
        return np.asarray(at)

    def rate_for(self, quality: float) -> float | None:
        """The least rate of at least this quality; None: no point has it."""
        if not len(self.rates) or quality > self.qualities[-1]:
            return None
        if quality <= self.qualities[0]:
            return float(self.rates[0])
        return float(np.exp(np.interp(quality, self.qualities, np.log(self.rates))))


def curve_of(points: Sequence[Point], measure: str, duration_s: float) -> Curve:
    """The curve of a codec's points by one measure, for calls of this length."""
    measured = [
        (point.total_bps(duration_s), float(point.figures[measure]))
        for point in points
        if point.figures.get(measure) is not None
    ]
    best: list[tuple[float, float]] = []
    for rate, quality in sorted(measured, key=lambda each: (each[0], -each[1])):
        if not best or quality > best[-1][1]:
            best.append((rate, quality))
    rates, qualities = np.array(best).reshape(-1, 2).T
    return Curve(rates, qualities)


def crossing_bps(ours: Curve, theirs: Curve) -> float | None:
    """The least rate from which on `theirs` is always at least as good; None: nowhere.

    Ours is taken to stay as it is above its highest rate.
    """
    if not len(ours.rates) or not len(theirs.rates):
        return None
    low, high = theirs.rates[0], theirs.rates[-1]
    decades = np.log10(max(high / low, 1.0))
    grid = np.geomspace(low, high, max(2, int(decades * STEPS_PER_DECADE)))
    is_better = theirs.quality_at(grid) >= ours.quality_at(grid)
    if not is_better[-1]:
        return None
    worse = np.flatnonzero(~is_better)
    return float(grid[worse[-1] + 1 if len(worse) else 0])


def bd_rate_percent(ours: Curve, theirs: Curve) -> float | None:
    """By how many percent `theirs` needs more bits for equal quality, on average where both have it
    (Bjontegaard 2001, with straight lines); None: no quality is common to both."""
    if min(len(ours.rates), len(theirs.rates)) < 2:
        return None
    low = max(ours.qualities[0], theirs.qualities[0])
    high = min(ours.qualities[-1], theirs.qualities[-1])
    if low >= high:
        return None
    grid = np.linspace(low, high, 201)
    logs = [np.interp(grid, each.qualities, np.log(each.rates)) for each in (ours, theirs)]
    return float(100 * np.expm1(np.mean(logs[1] - logs[0])))
