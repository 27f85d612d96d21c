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
from aam.warps import head_warp
from aam.window import FaceWindow, shrunk
from benchmarks.validate_aam.contenders import Contender, start_pose
from benchmarks.validate_aam.samples import Sample
from benchmarks.validate_aam.units.classifiers import (
    Classifier,
    by_folds,
    components,
    regressed,
    scaled,
    separated,
)
from benchmarks.validate_aam.units.expressed_faces import (
    EXPRESSIONS,
    INTENSITIES,
    UNITS,
    with_units,
)
from benchmarks.validate_aam.units.gradient_histograms import gradient_histograms
from benchmarks.validate_aam.units.outcomes import Recognition, found_units, judged_units
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Single
from shared_model.parameters import EAU_INDEX

# Shares of what is shown that may be false by the learned folds: the thesis' (Tables 3.3, 3.4).
FALSE_OF_KNOWN, FALSE_OF_NEW = 0.017, 0.044
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


@dataclass(frozen=True, slots=True, eq=False)
class ShownFaces:
    """What a search finds on n pictures of drawn expressions.

    shown: (n, 6) intensity of each unit.  people: (n,) who it is.  pictures: (n,) of which picture.
    strengths: (n, 6) of each unit in the EAUs found.  eau: (n, 14) three times the EAUs found, of
        their ranges.  combined: (n, m) c in standard deviations.
    texture: (n, k) what is there under the face found, its EAUs at rest: what an expression moves
        stands where it has gone to.  gradients: (n, l) histograms of that of the full face, without
        normalisation of its light.
    """

    shown: Array
    people: NDArray[np.str_]
    pictures: NDArray[np.str_]
    strengths: Array
    eau: Array
    combined: Array
    texture: Single
    gradients: Single


def show_faces(
    contender: Contender, samples: Sequence[Sample], anchors: str = "eyes"
) -> ShownFaces:
    """Every expression on every face, at each intensity, searched from the eyes.

    contender: an AAM of the head.  anchors: where searches start, see `start_pose`.
    """
    shows = [
        (sample, units, intensity)
        for sample in samples
        for units in EXPRESSIONS
        for intensity in (INTENSITIES if units else (1.0,))
    ]

    def one(show: tuple[Sample, tuple[str, ...], float]) -> _Features:
        return _features(contender, with_units(*show), anchors)

    found = parallel_map(one, shows, None)
    return ShownFaces(
        np.array([[i * (name in units) for name in UNITS] for _, units, i in shows]),
        np.array([sample.face.person for sample, _, _ in shows]),
        np.array([sample.face.name for sample, _, _ in shows]),
        *(np.array(each) for each in zip(*found, strict=True)),
    )


def recognise(
    learned: ShownFaces, known: ShownFaces, new: ShownFaces
) -> dict[str, tuple[Recognition, Recognition | None]]:
    """Units of known and of new people by classifiers that learn from other pictures.

    "thresholds": the EAUs themselves say how strong a unit is, as in the thesis.  "linear": ridge
    regression on EAUs and combined parameters.  "SVM": a support vector machine for each unit on
    the same, with radial basis functions.  "SVM of texture": on EAUs and principal components of
    the texture.  "SVM of gradients": on these and components of the gradients.  "SVM less own
    neutral": on the same less those of the person's neutral faces, of known people alone.  A unit
    counts as found above a threshold that was chosen on the learned faces by machines that have not
    seen the people, see `found_units`.
    """
    judged = [known, new]
    eau = [np.hstack([each.strengths, each.eau]) for each in (learned, *judged)]
    combined = _joined(eau, [each.combined for each in (learned, *judged)])
    texture = components([each.texture for each in (learned, *judged)], TEXTURE_COMPONENTS)
    textured = _joined(eau, texture)
    gradients = components([each.gradients for each in (learned, *judged)], GRADIENT_COMPONENTS)
    edged = _joined(textured, gradients)
    own = own_neutrals(edged[0], learned, edged[0], learned)
    less = [edged[0] - own, edged[1] - own_neutrals(edged[0], learned, edged[1], known)]

    def by(classifier: Classifier, rows: Sequence[Array]) -> list[Array]:
        return by_folds(classifier, scaled(rows), learned.shown, learned.people)

    strengths = {
        "thresholds": [each.strengths for each in (learned, *judged)],
        "linear": by(regressed, combined),
        "SVM": by(separated, combined),
        "SVM of texture": by(separated, textured),
        "SVM of gradients": by(separated, edged),
        "SVM less own neutral": by(separated, less),
    }
    results = {}
    for name, (taught, *found) in strengths.items():
        pairs = zip(found, judged, (FALSE_OF_KNOWN, FALSE_OF_NEW), strict=False)
        own_results = [
            judged_units(each, faces.shown, found_units(taught, learned.shown, each, share))
            for each, faces, share in pairs
        ]
        results[name] = own_results[0], own_results[1] if len(own_results) > 1 else None
    return results


def own_neutrals(features: Array, learned: ShownFaces, rows: Array, faces: ShownFaces) -> Array:
    """(n, m) for each row of faces the mean features of the person's neutral faces among the
    learned, of other pictures than the row's if there are any.

    features: (l, m) of the learned faces.  rows: (n, m) of the faces.
    """
    is_neutral, found = learned.shown.sum(1) == 0, np.zeros_like(rows)
    for number, (person, picture) in enumerate(zip(faces.people, faces.pictures, strict=True)):
        own = is_neutral & (learned.people == person)
        others = own & (learned.pictures != picture)
        chosen = others if others.any() else own
        if chosen.any():
            found[number] = features[chosen].mean(0)
    return found


def _joined(rows: Sequence[Array], others: Sequence[NDArray[np.floating]]) -> list[Array]:
    """Features of several sets of faces, side by side."""
    return [np.hstack([one, other]) for one, other in zip(rows, others, strict=True)]


# Strengths, EAUs, combined parameters, texture and gradients of a picture, see `ShownFaces`.
_Features = tuple[Array, Array, Array, Single, Single]


def _features(contender: Contender, sample: Sample, anchors: str) -> _Features:
    normalisation, window = contender.options.normalisation, sample.face.window
    start = start_pose(contender, sample, np.zeros(2), 1.0, anchors)
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
