"""Recognition of action units (3.2): the EAUs that a search finds, against what was shown."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.model import texture_at
from aam.sampling import normalised_luma, window_px
from aam.search.find_face import find_in_window
from aam.search.search import SearchOptions
from aam.shape_space import SHAPE_RANGE, actuators
from aam.validation.contenders import Contender, start_pose
from aam.validation.expressed_faces import EXPRESSIONS, INTENSITIES, UNITS, with_units
from aam.validation.samples import Sample
from aam.window import FaceWindow, shrunk
from encoder.runtime.parallel import parallel_map
from shared_model.parameters import EAU_INDEX

Array = NDArray[np.float64]

# How many strengths are tried at which a unit may count as shown.
THRESHOLDS = 64
# Of the linear classifier, for each picture; of the support vector machines, whose features have
# unit variance: cost of an error, and width of the functions for each feature.
RIDGE, SVM_COST, SVM_WIDTH = 0.6, 3.0, 0.3
# Chosen by cross-validation over people of the training set, with the cost.
TEXTURE_COMPONENTS = 50
# Parts of the learned people, each judged by what was learned from the others.
FOLDS = 4
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


@dataclass(frozen=True, slots=True, eq=False)
class ShownFaces:
    """What a search finds on n pictures of drawn expressions.

    shown: (n, 6) intensity of each unit.  people: (n,) who it is.
    strengths: (n, 6) of each unit in the EAUs found.  eau: (n, 14) three times the EAUs found, of
        their ranges.  combined: (n, m) c in standard deviations.
    texture: (n, k) what is there under the face found, its EAUs at rest: what an expression moves
        stands where it has gone to.
    """

    shown: Array
    people: NDArray[np.str_]
    strengths: Array
    eau: Array
    combined: Array
    texture: NDArray[np.float32]


def show_faces(contender: Contender, samples: Sequence[Sample]) -> ShownFaces:
    """Every expression on every face, at each intensity, searched from the eyes.

    contender: an AAM of the head.
    """
    shows = [
        (sample, units, intensity)
        for sample in samples
        for units in EXPRESSIONS
        for intensity in (INTENSITIES if units else (1.0,))
    ]

    def one(show: tuple[Sample, tuple[str, ...], float]) -> _Features:
        return _features(contender, with_units(*show))

    found = parallel_map(one, shows, None)
    return ShownFaces(
        np.array([[i * (name in units) for name in UNITS] for _, units, i in shows]),
        np.array([sample.face.person for sample, _, _ in shows]),
        *(np.array(each) for each in zip(*found, strict=True)),
    )


def recognise(learned: ShownFaces, judged: ShownFaces) -> dict[str, Recognition]:
    """Units of the judged faces by classifiers that learn from the others.

    "thresholds": the EAUs themselves say how strong a unit is, as in the thesis.  "linear": ridge
    regression on EAUs and combined parameters.  "SVM": a support vector machine for each unit on
    the same, with radial basis functions.  "SVM of texture": on EAUs and principal components of
    the texture.  A unit counts as found above a threshold that was chosen on the learned faces,
    unit by unit, by machines that have not seen the people.
    """
    combined = _scaled(*(np.hstack([e.strengths, e.eau, e.combined]) for e in (learned, judged)))
    texture = _components(learned.texture, judged.texture)
    pairs = zip((learned, judged), texture, strict=True)
    textured = _scaled(*(np.hstack([e.strengths, e.eau, own]) for e, own in pairs))
    strengths = {
        "thresholds": (learned.strengths, judged.strengths),
        "linear": _by_folds(_regressed, *combined, learned),
        "SVM": _by_folds(_separated, *combined, learned),
        "SVM of texture": _by_folds(_separated, *textured, learned),
    }
    return {name: _judged(*pair, learned.shown, judged.shown) for name, pair in strengths.items()}


def _scaled(known: Array, new: Array) -> tuple[Array, Array]:
    scale = np.maximum(known.std(0), 1e-6)
    return known / scale, new / scale


def _components(
    known: NDArray[np.float32], new: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rows (n, k) of known and new textures along the first principal axes of the known ones."""
    mean = known.mean(0)
    _, axes = np.linalg.eigh((known - mean).T @ (known - mean))
    chosen = axes[:, : -TEXTURE_COMPONENTS - 1 : -1]
    return (known - mean) @ chosen, (new - mean) @ chosen


# Learns from rows and the intensities shown; the strengths (n, 6) of other rows.
_Classifier = Callable[[Array, Array, Array], Array]


def _by_folds(
    classifier: _Classifier, known: Array, new: Array, learned: ShownFaces
) -> tuple[Array, Array]:
    """Strengths of known rows, each by what was learned from other people, for thresholds; and of
    new rows.
    """
    _, person = np.unique(learned.people, return_inverse=True)
    fold, own = person % FOLDS, np.zeros(learned.shown.shape)
    for number in range(FOLDS):
        inside = fold == number
        own[inside] = classifier(known[~inside], learned.shown[~inside], known[inside])
    return own, classifier(known, learned.shown, new)


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


# Strengths, EAUs, combined parameters and texture of a picture, see `ShownFaces`.
_Features = tuple[Array, Array, Array, NDArray[np.float32]]


def _features(contender: Contender, sample: Sample) -> _Features:
    normalisation, window = contender.options.normalisation, sample.face.window
    start = start_pose(contender, sample, np.zeros(2), 1.0)
    fit = find_in_window(
        contender.levels, contender.warps, normalisation, window, [start], SearchOptions()
    )
    _, eau = actuators(fit.shape)
    relative = eau / SHAPE_RANGE[-len(eau) :]
    strengths = [
        np.mean([sign * relative[EAU_INDEX[name]] for name, sign in parts])
        for parts in STRENGTHS.values()
    ]
    warp, rest = contender.warps[-1], fit.shape.copy()
    rest[-len(eau) :] = 0
    view = shrunk(FaceWindow(window.picture, np.zeros(2), 1.0), window_px(warp.size))
    luma = normalised_luma(view, normalisation)
    texture = texture_at(warp, luma, rest, view.pose_to_window(fit.pose))
    c = fit.results[-1].c / contender.levels[-1].deviations
    return np.array(strengths), 3 * relative, c, texture


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
