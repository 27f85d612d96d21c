"""What came of each unit that is shown, as the thesis counts it (Tables 3.3 and 3.4).

The outcomes of a shown unit exclude each other, so that they add up to what is shown: right: it is
found, and nothing that is not shown; false: it is found, and something that is not shown; missed:
it is not found, nor anything that is not shown; confused: it is not found, but something else that
is not shown.  A neutral face is right if nothing is found and else false.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.validate_aam.units.expressed_faces import UNITS
from risorius.track_bench.unit_scores import area_under_curve
from shared_model.arrays import Array, Mask

OUTCOMES = ("right", "false", "missed", "confused")
# False-positive rates of a unit among the learned faces that do not show it, of which one is taken.
RATES = (0.1, 0.07, 0.05, 0.03, 0.02, 0.014, 0.01, 0.007, 0.005, 0.003, 0.002, 0.001)


@dataclass(frozen=True, slots=True)
class UnitResult:
    """Outcomes of the pictures that show a unit, see above.

    found: pictures in which the unit was found, of those that show it.  absent: pictures that do
    not show the unit.  alarms: those of `absent` in which it was found.
    auc: area under the curve of found over alarms.
    """

    right: int
    false: int
    missed: int
    confused: int
    found: int
    alarms: int
    absent: int
    auc: float

    @property
    def shown(self) -> int:
        """Pictures that show it."""
        return self.right + self.false + self.missed + self.confused

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.found / max(self.found + self.alarms + self.shown, 1)

    @property
    def false_positive_rate(self) -> float:
        """Share of `absent` in which the unit was found."""
        return self.alarms / max(self.absent, 1)


@dataclass(frozen=True, slots=True)
class Recognition:
    """units: by name, "Neutral" first."""

    units: dict[str, UnitResult]

    def share(self, outcome: str) -> float:
        """Of all that is shown, neutral faces too, the share of one of `OUTCOMES`."""
        shown = sum(each.shown for each in self.units.values())
        return float(sum(getattr(each, outcome) for each in self.units.values()) / shown)

    def mean(self, measure: str) -> float:
        """Mean of "f1", "auc" or "false_positive_rate" over the units."""
        units = [each for name, each in self.units.items() if name != "Neutral"]
        return float(np.mean([getattr(each, measure) for each in units]))


def found_units(known: Array, taught: Array, strengths: Array, false: float) -> Mask:
    """(n, 6) units that are found in pictures by their strengths (n, 6).

    known: (l, 6) strengths of learned pictures, by machines that have not seen the people.
    taught: (l, 6) intensities that these show.  Every unit's threshold lets pass the same share of
    the learned pictures that do not show it, the greatest of `RATES` by which the share of false
    outcomes of the learned pictures is at most `false`, 0..1.
    """
    for rate in RATES:
        thresholds = np.array(
            [
                np.quantile(known[taught[:, unit] == 0, unit], 1 - rate)
                for unit in range(taught.shape[1])
            ]
        )
        if judged_units(known, taught, known > thresholds).share("false") <= false:
            break
    return np.asarray(strengths > thresholds)


def judged_units(strengths: Array, shown: Array, found: Mask) -> Recognition:
    """strengths, shown: (n, 6) found and true intensities.  found: (n, 6) which units are."""
    is_shown = shown > 0
    has_alarm = (found & ~is_shown).any(1)
    neutral = ~is_shown.any(1)
    anything = found.any(1)
    wrong = int((neutral & anything).sum())
    alarms = int((~neutral & ~anything).sum())
    counts = int(neutral.sum()) - wrong, wrong, 0, 0
    own = counts[0], alarms, int((~neutral).sum()), float("nan")
    results = {"Neutral": UnitResult(*counts, *own)}
    for unit, name in enumerate(UNITS):
        true, hit = is_shown[:, unit], found[:, unit]
        outcomes = (hit & ~has_alarm, hit & has_alarm, ~hit & ~has_alarm, ~hit & has_alarm)
        right, false, missed, confused = (int((true & each).sum()) for each in outcomes)
        area = area_under_curve(strengths[:, unit], true)
        alarms, absent = int((hit & ~true).sum()), int((~true).sum())
        results[name] = UnitResult(
            right, false, missed, confused, right + false, alarms, absent, area
        )
    return Recognition(results)
