"""Recognition of action units (3.2): the EAUs that a search finds, against what was shown."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
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

# How many strengths are tried at which a unit may count as shown.
THRESHOLDS = 64
# Of the linear classifier, for each picture; of the support vector machines, whose features have
# unit variance: cost of an error, and width of the functions for each feature.
RIDGE, SVM_COST, SVM_WIDTH = 0.6, 1.0, 0.3
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


def recognise(
    contender: Contender, learned: Sequence[Sample], judged: Sequence[Sample]
) -> dict[str, Recognition]:
    """Every expression on every face, at each intensity, searched from the eyes.

    "thresholds": the EAUs themselves say how strong a unit is, as in the thesis.  "linear": ridge
    regression on EAUs and combined parameters.  "SVM": a support vector machine for each unit on
    the same, with radial basis functions.  All learn from the first faces, and a unit counts as
    found above a threshold that was chosen there, unit by unit.
    """
    (known, taught), (new, shown) = (
        _shown_and_found(contender, each) for each in (learned, judged)
    )
    scale = np.maximum(known.std(0), 1e-6)
    known, new = known / scale, new / scale
    strengths = {
        "thresholds": (known[:, : len(UNITS)], new[:, : len(UNITS)]),
        "linear": _by_two_halves(_regressed, known, taught, new),
        "SVM": _by_two_halves(_separated, known, taught, new),
    }
    return {name: _judged(*pair, taught, shown) for name, pair in strengths.items()}


def _shown_and_found(contender: Contender, samples: Sequence[Sample]) -> tuple[Array, Array]:
    """Features (n, f) of each expression on each face, and the intensities (n, 6) shown."""
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
    return features, np.array([[i * (name in units) for name in UNITS] for _, units, i in shows])


# Learns from rows and the intensities shown; the strengths (n, 6) of other rows.
_Classifier = Callable[[Array, Array, Array], Array]


def _by_two_halves(
    classifier: _Classifier, known: Array, taught: Array, new: Array
) -> tuple[Array, Array]:
    """Strengths of known rows, of each half by the other, for thresholds; and of new rows.

    Rows of one face follow each other.
    """
    half = np.arange(len(known)) < len(known) / 2
    own = np.zeros(taught.shape)
    for side in (half, ~half):
        own[~side] = classifier(known[side], taught[side], known[~side])
    return own, classifier(known, taught, new)


def _judged(known: Array, found: Array, taught: Array, shown: Array) -> Recognition:
    """known, found: strengths (n, 6), of which thresholds are chosen and of which units are found.
    taught, shown: intensities of either.
    """
    is_found = np.zeros(shown.shape, bool)
    for column in range(len(UNITS)):
        threshold = _threshold(known[:, column], taught[:, column] > 0)
        is_found[:, column] = found[:, column] > threshold
    results = {"Neutral": _counted((shown > 0).sum(1) == 0, is_found.sum(1) == 0)}
    for column, name in enumerate(UNITS):
        results[name] = _counted(shown[:, column] > 0, is_found[:, column])
    pairs = zip(UNITS, found.T, shown.T, strict=True)
    correlation = {name: _correlation(a, b) for name, a, b in pairs}
    return Recognition(results, correlation)


def _regressed(known: Array, taught: Array, new: Array) -> Array:
    mean, level = known.mean(0), taught.mean(0)
    rows = known - mean
    system = rows.T @ rows + RIDGE * len(rows) * np.eye(rows.shape[1])
    return np.asarray((new - mean) @ np.linalg.solve(system, rows.T @ (taught - level)) + level)


def _separated(known: Array, taught: Array, new: Array) -> Array:
    mean = known.mean(0)
    rows, others = (np.asarray(each - mean, np.float32) for each in (known, new))
    found = np.zeros((len(new), len(UNITS)))
    for column in range(len(UNITS)):
        is_shown = (taught[:, column] > 0).astype(np.int32)
        machine = cv2.ml.SVM.create()
        machine.setType(cv2.ml.SVM_C_SVC)
        machine.setKernel(cv2.ml.SVM_RBF)
        machine.setC(SVM_COST)
        machine.setGamma(SVM_WIDTH / rows.shape[1])
        # Both answers count alike, however often each is right.
        machine.setClassWeights(
            0.5 / np.maximum(np.bincount(is_shown, minlength=2) / len(rows), 0.01)
        )
        machine.train(rows, cv2.ml.ROW_SAMPLE, is_shown)
        _, distance = machine.predict(others, flags=cv2.ml.STAT_MODEL_RAW_OUTPUT)
        # Of the first class, 0, the distance is positive.
        found[:, column] = -distance[:, 0]
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
    tried = np.quantile(strength, np.linspace(0, 1, THRESHOLDS))
    found = strength[None] > tried[:, None]
    hits = (found & shown).sum(1) / max(int(shown.sum()), 1)
    rejections = (~found & ~shown).sum(1) / max(int((~shown).sum()), 1)
    return float(tried[int((hits + rejections).argmax())])


def _counted(shown: NDArray[np.bool_], found: NDArray[np.bool_]) -> UnitResult:
    correct, false = int((shown & found).sum()), int((~shown & found).sum())
    return UnitResult(
        int(shown.sum()), correct, int(shown.sum()) - correct, false, int((~shown).sum())
    )
