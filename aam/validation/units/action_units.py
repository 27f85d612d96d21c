"""Recognition of action units (3.2): the EAUs that a search finds, against what was shown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aam.model import texture_at
from aam.sampling import normalised_luma, window_px
from aam.search.find_face import find_in_window
from aam.search.search import SearchOptions
from aam.shape_space import SHAPE_RANGE, actuators
from aam.validation.contenders import Contender, start_pose
from aam.validation.samples import Sample
from aam.validation.units.classifiers import (
    Classifier,
    by_folds,
    components,
    regressed,
    scaled,
    separated,
)
from aam.validation.units.expressed_faces import EXPRESSIONS, INTENSITIES, UNITS, with_units
from aam.validation.units.gradient_histograms import gradient_histograms
from aam.warps import head_warp
from aam.window import FaceWindow, shrunk
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Mask, Single
from shared_model.parameters import EAU_INDEX

# How many strengths are tried at which a unit may count as shown.
THRESHOLDS = 64
# Chosen by cross-validation over people of the training set.
TEXTURE_COMPONENTS, GRADIENT_COMPONENTS = 50, 150
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

    @property
    def false_of_shown(self) -> float:
        """Units found that are not there, of all units and neutral faces shown (Table 3.4)."""
        false = sum(each.false for name, each in self.units.items() if name != "Neutral")
        return false / sum(each.shown for each in self.units.values())


@dataclass(frozen=True, slots=True, eq=False)
class ShownFaces:
    """What a search finds on n pictures of drawn expressions.

    shown: (n, 6) intensity of each unit.  people: (n,) who it is.
    strengths: (n, 6) of each unit in the EAUs found.  eau: (n, 14) three times the EAUs found, of
        their ranges.  combined: (n, m) c in standard deviations.
    texture: (n, k) what is there under the face found, its EAUs at rest: what an expression moves
        stands where it has gone to.  gradients: (n, l) histograms of that of the full face, without
        normalisation of its light.
    """

    shown: Array
    people: NDArray[np.str_]
    strengths: Array
    eau: Array
    combined: Array
    texture: Single
    gradients: Single


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
    the texture.  "SVM of gradients": on these and components of the gradients.  A unit counts as
    found above a threshold that was chosen on the learned faces, unit by unit, by machines that
    have not seen the people.
    """
    both = learned, judged
    eau = [np.hstack([each.strengths, each.eau]) for each in both]
    combined = _joined(eau, [each.combined for each in both])
    texture = components(learned.texture, judged.texture, TEXTURE_COMPONENTS)
    textured = _joined(eau, texture)
    gradients = components(learned.gradients, judged.gradients, GRADIENT_COMPONENTS)
    edged = _joined(textured, gradients)

    def by(classifier: Classifier, rows: Sequence[Array]) -> tuple[Array, Array]:
        return by_folds(classifier, *scaled(rows[0], rows[1]), learned.shown, learned.people)

    strengths = {
        "thresholds": (learned.strengths, judged.strengths),
        "linear": by(regressed, combined),
        "SVM": by(separated, combined),
        "SVM of texture": by(separated, textured),
        "SVM of gradients": by(separated, edged),
    }
    return {name: _judged(*pair, learned.shown, judged.shown) for name, pair in strengths.items()}


def _joined(rows: Sequence[Array], others: Sequence[NDArray[np.floating]]) -> list[Array]:
    """Features of the learned and of the judged faces, side by side."""
    return [np.hstack([one, other]) for one, other in zip(rows, others, strict=True)]


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


# Strengths, EAUs, combined parameters, texture and gradients of a picture, see `ShownFaces`.
_Features = tuple[Array, Array, Array, Single, Single]


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
    pose, full = view.pose_to_window(fit.pose), head_warp(warp.size, "full")
    texture = texture_at(warp, normalised_luma(view, normalisation), rest, pose)
    whole = texture_at(full, normalised_luma(view, "none"), rest, pose)
    gradients = gradient_histograms(warp.size, "full", whole)
    c = fit.results[-1].c / contender.levels[-1].deviations
    return np.array(strengths), 3 * relative, c, texture, gradients


def _correlation(one: Array, other: Array) -> float:
    one, other = one - one.mean(), other - other.mean()
    scale = float(np.linalg.norm(one)) * float(np.linalg.norm(other))
    return float(one @ other) / max(scale, 1e-12)


def _threshold(strength: Array, shown: Mask) -> float:
    """The threshold of the best balanced accuracy."""
    tried = np.quantile(strength, np.linspace(0, 1, THRESHOLDS))
    found = strength[None] > tried[:, None]
    hits = (found & shown).sum(1) / max(int(shown.sum()), 1)
    rejections = (~found & ~shown).sum(1) / max(int((~shown).sum()), 1)
    return float(tried[int((hits + rejections).argmax())])


def _counted(shown: Mask, found: Mask) -> UnitResult:
    correct, false = int((shown & found).sum()), int((~shown & found).sum())
    return UnitResult(
        int(shown.sum()), correct, int(shown.sum()) - correct, false, int((~shown).sum())
    )
