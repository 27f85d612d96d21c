"""F1 and area under the curve of each action unit, over the frames of all clips."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from risorius.track_bench.unit_labels import UnitLabels
from shared_model.arrays import Array, Mask

# Intensity, 0..1, from which the tracker has found a unit: that of OpenFace's presence, 1 of 5.
FOUND = 0.2


@dataclass(frozen=True, slots=True)
class UnitScore:
    """How well one unit is found.

    judged: frames.  shown: frames that show the unit.  recall, precision, f1: where intensities
    from `FOUND` on count as found.  auc: of the intensities; None if all frames, or none, show it.
    """

    judged: int
    shown: int
    recall: float
    precision: float
    f1: float
    auc: float | None


def unit_scores(
    clips: Sequence[tuple[Mapping[str, Array], UnitLabels]],
) -> dict[str, UnitScore]:
    """The score of each unit that is both tracked and coded, by name.

    clips: of each the intensities (t,) by unit, nan without a face, and its labels.  A frame
    without a face counts as one in which nothing is found; one that was not tracked is left out.
    """
    strengths: dict[str, list[Array]] = {}
    truths: dict[str, list[Mask]] = {}
    for intensities, labels in clips:
        for unit, values in intensities.items():
            if unit not in labels.shown and not labels.is_complete:
                continue
            inside = (labels.frames >= 0) & (labels.frames < len(values))
            shown = labels.shown.get(unit, np.zeros(len(labels.frames), dtype=np.bool_))
            strengths.setdefault(unit, []).append(np.nan_to_num(values[labels.frames[inside]]))
            truths.setdefault(unit, []).append(shown[inside])
    return {
        unit: _score(np.concatenate(strengths[unit]), np.concatenate(truths[unit]))
        for unit in strengths
    }


def area_under_curve(strengths: Array, shown: Mask) -> float:
    """Area under the ROC curve.  strengths, shown: (n,), of each picture.

    That is how often a picture that shows a unit has a greater strength than a picture that does
    not, over all such pairs; equal strengths count half.
    """
    low, high = np.sort(strengths[~shown]), strengths[shown]
    below = np.searchsorted(low, high, "left") + np.searchsorted(low, high, "right")
    return float(below.sum() / 2 / max(len(low) * len(high), 1))


def _score(strengths: Array, shown: Mask) -> UnitScore:
    found = strengths >= FOUND
    hits, wanted = int((found & shown).sum()), int(shown.sum())
    both = int(found.sum()) + wanted
    return UnitScore(
        judged=len(shown),
        shown=wanted,
        recall=hits / max(wanted, 1),
        precision=hits / max(int(found.sum()), 1),
        f1=2 * hits / max(both, 1),
        auc=area_under_curve(strengths, shown) if 0 < wanted < len(shown) else None,
    )
