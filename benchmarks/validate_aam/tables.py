"""The results of the validation as Markdown, each of the thesis' figures beside ours."""

from collections.abc import Mapping, Sequence

from benchmarks.validate_aam.prediction_experiments import PredictionCurve
from benchmarks.validate_aam.search_experiments import Generalisation
from benchmarks.validate_aam.units.outcomes import OUTCOMES, Recognition
from loopback.report import markdown_table
from shared_model.arrays import Array

# Table 2.5: percent and degrees.
THESIS_POSE = {
    "head": {"tx": 2.6, "ty": 2.5, "scale": 2.09, "rx": 4.03, "ry": 2.60, "rz": 1.03},
    "2D": {"tx": 1.4, "ty": 2.3, "scale": 1.21, "turn": 0.91},
}
# Tables 3.3 and 3.4: shown, right, false, missed, confused.
THESIS_KNOWN = {
    "Neutral": (20, 19, 1, 0, 0),
    "AU1": (24, 21, 0, 3, 0),
    "AU2": (52, 41, 1, 9, 1),
    "AU4": (42, 41, 0, 0, 1),
    "AU12": (51, 48, 3, 0, 0),
    "AU15": (18, 17, 0, 1, 0),
    "AU26": (74, 55, 0, 19, 0),
}
THESIS_NEW = {
    "Neutral": (20, 17, 3, 0, 0),
    "AU1": (10, 8, 0, 2, 0),
    "AU2": (27, 20, 1, 5, 1),
    "AU4": (24, 21, 1, 1, 1),
    "AU12": (17, 13, 0, 4, 0),
    "AU15": (13, 10, 1, 2, 0),
    "AU26": (24, 14, 0, 10, 0),
}


def thesis_percent(count: int, shown: int) -> float:
    """A share as the thesis prints it: its Tables 3.3 and 3.4 cut percentages off after a tenth."""
    return 1000 * count // shown / 10


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    return f"{markdown_table(head, rows)}\n"


def pose_table(curves: Mapping[str, Mapping[str, Sequence[PredictionCurve]]]) -> str:
    """Mean errors of predicted pose displacements (Table 2.5).

    curves: by contender ("head", "2D"), then by set of pictures.
    """
    sets = list(next(iter(curves.values())))
    rows = []
    for contender, by_set in curves.items():
        for number, curve in enumerate(next(iter(by_set.values()))):
            thesis = THESIS_POSE[contender].get(curve.name, "-")
            errors = [f"{by_set[name][number].error:.2f}" for name in sets]
            rows.append([contender, curve.name, curve.unit, thesis, *errors])
    return table(["AAM", "parameter", "unit", "thesis", *sets], rows)


def range_table(curves: Mapping[str, Sequence[PredictionCurve]]) -> str:
    """Linear ranges of rotations (Fig. 2.22), by what predicts and of whom."""
    thesis = {"rx": "-30 to 10", "ry": "-20 to 20", "rz": "-15 to 15"}
    names = [each.name for each in next(iter(curves.values()))]
    rows = [["thesis", *(thesis[name] for name in names)]]
    for label, own in curves.items():
        rows.append([label, *("{:.0f} to {:.0f}".format(*each.linear_range) for each in own)])
    return table(["prediction", *names], rows)


def parameter_table(curves: Mapping[str, Sequence[PredictionCurve]]) -> str:
    """Mean errors of displaced combined parameters (Table 2.6)."""
    rows = [[name, *(f"{100 * curve.error:.1f}" for curve in own)] for name, own in curves.items()]
    count = max(len(own) for own in curves.values())
    return table(["% of a standard deviation", *(f"c{i}" for i in range(count))], rows)


def search_table(results: Mapping[tuple[str, str, str], Generalisation]) -> str:
    """Generalisation (Table 3.1), by contender, way of search and start."""
    rows = [
        [
            *names,
            f"{each.error:.1f}",
            f"{100 * each.nme.mean():.2f}",
            f"{100 * each.right:.1f}",
        ]
        for names, each in results.items()
    ]
    head = ["AAM", "search", "start", "error, px^2", "mean distance, %", "below 5 %, %"]
    return table(head, rows)


def convergence_table(paths: Mapping[str, Sequence[Array]]) -> str:
    """Mean distance by iteration (Fig. 3.1 to 3.3), by contender and then by level."""
    rows = [
        [contender, number, *(f"{100 * value:.2f}" for value in level)]
        for contender, levels in paths.items()
        for number, level in enumerate(levels)
    ]
    text = "Mean distance by iteration, additive search from displaced starts, %:\n\n"
    return text + table(["AAM", "level", *map(str, range(len(rows[0]) - 2))], rows)


def unit_table(found: Recognition, thesis: Mapping[str, tuple[int, ...]]) -> str:
    """Outcomes of action units (Tables 3.3 and 3.4) beside the thesis', % of what is shown, and F1,
    area under the curve and false-positive rate of each.
    """
    rows = []
    for name, unit in found.units.items():
        outcomes = [f"{100 * getattr(unit, each) / max(unit.shown, 1):.1f}" for each in OUTCOMES]
        others = ["-", "-", "-"]
        if name != "Neutral":
            rate = f"{100 * unit.false_positive_rate:.1f}"
            others = [f"{unit.f1:.2f}", f"{unit.auc:.3f}", rate]
        shown, *counts = thesis[name]
        theirs = [f"{thesis_percent(each, shown):.1f}" for each in counts]
        rows.append([name, unit.shown, *_beside(outcomes, theirs), *others])
    outcomes = [f"{100 * found.share(each):.1f}" for each in OUTCOMES]
    of_all, *counts = (sum(each) for each in zip(*thesis.values(), strict=True))
    theirs = [f"{thesis_percent(each, of_all):.1f}" for each in counts]
    shown = sum(unit.shown for unit in found.units.values())
    means = [f"{found.mean('f1'):.2f}", f"{found.mean('auc'):.3f}"]
    rate = f"{100 * found.mean('false_positive_rate'):.1f}"
    rows.append(["all", shown, *_beside(outcomes, theirs), *means, rate])
    head = ["unit", "shown", *(f"{each}, % (thesis)" for each in OUTCOMES)]
    return table([*head, "F1", "AUC", "false-positive rate, %"], rows)


def _beside(ours: Sequence[str], theirs: Sequence[str]) -> list[str]:
    return [f"{own} ({other})" for own, other in zip(ours, theirs, strict=True)]
