"""Recognition of action units (3.2): the EAUs that a search finds, against what was shown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aam.search.find_face import find_in_window
from aam.search.search import SearchOptions
from aam.shape_space import SHAPE_RANGE, actuators
from aam.validation.contenders import Contender, start_pose
from aam.validation.expressed_faces import EXPRESSIONS, INTENSITIES, UNITS, with_units
from aam.validation.samples import Sample
from encoder.runtime.parallel import parallel_map
from shared_model.parameters import EAU_INDEX

Array = NDArray[np.float64]

# Strengths at which a unit may count as shown.
THRESHOLDS = np.linspace(-0.4, 0.8, 49)
# Of the linear classifier, for each picture.
RIDGE = 0.6
# A unit's strength: mean of these EAUs, with their signs.
STRENGTHS = {
    "AU1": (("eyebrow_inner", 1.0),),
    "AU2": (("eyebrow_outer", 1.0), ("eyebrow_middle", 1.0)),
    "AU4": (("eyebrow_inner", -1.0), ("eyebrow_middle", -1.0)),
    "AU12": (("mouth_corners", 1.0),),
    "AU15": (("mouth_corners", -1.0),),
    "AU26": (("jaw_drop", 1.0),),
}
assert tuple(STRENGTHS) == tuple(UNITS)


@dataclass(frozen=True, slots=True)
class UnitResult:
    """Of one unit: pictures that show it, in which it was found, missed; others in which it was."""

    shown: int
    correct: int
    missed: int
    false: int
    absent: int

    @property
    def rate(self) -> float:
        """Share of its pictures in which it was found (Tables 3.3 and 3.4)."""
        return self.correct / max(self.shown, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Recognition:
    """units: by name, "Neutral" first.  correlation: of strength found and shown, by unit."""

    units: dict[str, UnitResult]
    correlation: dict[str, float]

    @property
    def rate(self) -> float:
        """Correct of all that was shown."""
        shown = sum(each.shown for each in self.units.values())
        return sum(each.correct for each in self.units.values()) / shown

    @property
    def false_alarms(self) -> float:
        """Share of pictures without a unit in which it was found, of all units."""
        units = [each for name, each in self.units.items() if name != "Neutral"]
        return sum(each.false for each in units) / sum(each.absent for each in units)


def recognise(contender: Contender, samples: Sequence[Sample]) -> dict[str, Recognition]:
    """Every expression on every face, at each intensity, searched from the eyes.

    "thresholds": the EAUs themselves say how strong a unit is, as in the thesis.  "linear": ridge
    regression on EAUs and combined parameters.  Both learn from the other half of the faces, and a
    unit counts as found above a threshold that was chosen there, unit by unit.
    """
    shows = [
        (number, units, intensity)
        for number in range(len(samples))
        for units in EXPRESSIONS
        for intensity in (INTENSITIES if units else (1.0,))
    ]

    def one(show: tuple[int, tuple[str, ...], float]) -> Array:
        number, units, intensity = show
        return _features(contender, with_units(samples[number], units, intensity))

    features = np.array(parallel_map(one, shows, None))
    shown = np.array([[i * (name in units) for name in UNITS] for _, units, i in shows])
    half = np.array([number % 2 for number, _, _ in shows])
    strengths = {
        "thresholds": features[:, : len(UNITS)],
        "linear": _regressed(features, shown, half),
    }
    return {name: _judged(each, shown, half) for name, each in strengths.items()}


def _judged(found: Array, shown: Array, half: NDArray[np.int_]) -> Recognition:
    """found, shown: (n, 6) strengths.  half: (n,) 0 or 1."""
    is_found = np.zeros(shown.shape, bool)
    for side in (0, 1):
        for column in range(len(UNITS)):
            learned = half != side
            threshold = _threshold(found[learned, column], shown[learned, column] > 0)
            is_found[half == side, column] = found[half == side, column] > threshold
    results = {"Neutral": _counted((shown > 0).sum(1) == 0, is_found.sum(1) == 0)}
    for column, name in enumerate(UNITS):
        results[name] = _counted(shown[:, column] > 0, is_found[:, column])
    pairs = zip(UNITS, found.T, shown.T, strict=True)
    correlation = {name: _correlation(a, b) for name, a, b in pairs}
    return Recognition(results, correlation)


def _regressed(features: Array, shown: Array, half: NDArray[np.int_]) -> Array:
    """(n, 6) strengths of one half by what the other half teaches."""
    found = np.zeros(shown.shape)
    for side in (0, 1):
        learned, other = half != side, half == side
        mean, level = features[learned].mean(0), shown[learned].mean(0)
        rows = features[learned] - mean
        system = rows.T @ rows + RIDGE * len(rows) * np.eye(rows.shape[1])
        weights = np.linalg.solve(system, rows.T @ (shown[learned] - level))
        found[other] = (features[other] - mean) @ weights + level
    return found


def _features(contender: Contender, sample: Sample) -> Array:
    """(6 + 14 + M,) strength of each unit in the shape that a search finds, its EAUs, and its
    combined parameters in standard deviations.
    """
    fit = find_in_window(
        contender.levels,
        contender.warps,
        contender.options.normalisation,
        sample.face.window,
        [start_pose(contender, sample, np.zeros(2), 1.0)],
        SearchOptions(),
    )
    _, eau = actuators(fit.shape)
    relative = eau / SHAPE_RANGE[-len(eau) :]
    units = [
        np.mean([sign * relative[EAU_INDEX[name]] for name, sign in parts])
        for parts in STRENGTHS.values()
    ]
    c = fit.results[-1].c / contender.levels[-1].deviations
    return np.concatenate([units, 3 * relative, c])


def _correlation(one: Array, other: Array) -> float:
    one, other = one - one.mean(), other - other.mean()
    scale = float(np.linalg.norm(one)) * float(np.linalg.norm(other))
    return float(one @ other) / max(scale, 1e-12)


def _threshold(strength: Array, shown: NDArray[np.bool_]) -> float:
    """The threshold of the best balanced accuracy."""
    found = strength[None] > THRESHOLDS[:, None]
    hits = (found & shown).sum(1) / max(int(shown.sum()), 1)
    rejections = (~found & ~shown).sum(1) / max(int((~shown).sum()), 1)
    return float(THRESHOLDS[int((hits + rejections).argmax())])


def _counted(shown: NDArray[np.bool_], found: NDArray[np.bool_]) -> UnitResult:
    correct, false = int((shown & found).sum()), int((~shown & found).sum())
    return UnitResult(
        int(shown.sum()), correct, int(shown.sum()) - correct, false, int((~shown).sum())
    )
