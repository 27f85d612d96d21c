"""Classifiers of action units: strengths of units from rows of features."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from shared_model.arrays import Array, Single

# Of the linear classifier, for each picture; of the support vector machines, whose features have
# unit variance: cost of an error, and width of the functions for each feature.  Chosen by
# cross-validation over people of the training set.
RIDGE, SVM_COST, SVM_WIDTH = 0.6, 3.0, 0.6
# Parts of the learned people, each judged by what was learned from the others.
FOLDS = 8

# Learns from rows and the intensities shown (n, units); the strengths of other rows.
Classifier = Callable[[Array, Array, Array], Array]


def scaled(rows: Sequence[Array]) -> list[Array]:
    """Sets of rows divided by the standard deviations of the first, which are learned from."""
    scale = np.maximum(rows[0].std(0), 1e-6)
    return [each / scale for each in rows]


def components(rows: Sequence[Single], count: int) -> list[Single]:
    """Sets of rows (n, count) along the first principal axes of the first of them."""
    mean = rows[0].mean(0)
    _, axes = np.linalg.eigh((rows[0] - mean).T @ (rows[0] - mean))
    chosen = axes[:, : -count - 1 : -1]
    return [(each - mean) @ chosen for each in rows]


def by_folds(
    classifier: Classifier, rows: Sequence[Array], taught: Array, people: NDArray[np.str_]
) -> list[Array]:
    """Strengths of the first set of rows, each by what was learned from other people, for
    thresholds; and of the other sets.

    taught: intensities shown by the first set, of these people.
    """
    known, *others = rows
    names, person = np.unique(people, return_inverse=True)
    fold, own = person % FOLDS, np.zeros(taught.shape)
    for number in range(min(FOLDS, len(names))):
        inside = fold == number
        own[inside] = classifier(known[~inside], taught[~inside], known[inside])
    judged = classifier(known, taught, np.concatenate(others))
    return [own, *np.split(judged, np.cumsum([len(each) for each in others])[:-1])]


def regressed(known: Array, taught: Array, new: Array) -> Array:
    """Ridge regression of the intensities."""
    mean, level = known.mean(0), taught.mean(0)
    rows = known - mean
    system = rows.T @ rows + RIDGE * len(rows) * np.eye(rows.shape[1])
    return np.asarray((new - mean) @ np.linalg.solve(system, rows.T @ (taught - level)) + level)


def separated(known: Array, taught: Array, new: Array) -> Array:
    """A support vector machine for each unit, with radial basis functions."""
    mean, units = known.mean(0), taught.shape[1]
    rows, others = (np.asarray(each - mean, np.float32) for each in (known, new))
    found = np.zeros((len(new), units))
    for column in range(units):
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
