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
    """Of one unit: frames that were judged, how many show it, and by intensities from `FOUND` on
    recall, precision and F1; auc: of the intensities, None if all frames show it or none does.
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
    """The share of pairs of a picture (n,) that shows a unit and one that does not of which the
    first has the greater strength; equal ones count half.
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
