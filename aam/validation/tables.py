"""The results of the validation as Markdown, each of the thesis' figures beside ours."""

from collections.abc import Mapping, Sequence

from aam.validation.prediction_experiments import PredictionCurve
from aam.validation.search_experiments import Generalisation
from aam.validation.units.action_units import Recognition

# Table 2.5: percent and degrees; Tables 3.3 and 3.4: recognition rates, percent.
THESIS_POSE = {
    "head": {"tx": 2.6, "ty": 2.5, "scale": 2.09, "rx": 4.03, "ry": 2.60, "rz": 1.03},
    "2D": {"tx": 1.4, "ty": 2.3, "scale": 1.21, "turn": 0.91},
}
THESIS_DEPENDENT = {
    **{"Neutral": 95.0, "AU1": 87.5, "AU2": 78.8, "AU4": 97.6, "AU12": 94.1},
    **{"AU15": 94.4, "AU26": 74.3},
}
THESIS_INDEPENDENT = {
    **{"Neutral": 85.0, "AU1": 80.0, "AU2": 74.0, "AU4": 87.5, "AU12": 76.4},
    **{"AU15": 76.9, "AU26": 58.3},
}


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n"


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


def unit_table(dependent: Recognition, independent: Recognition) -> str:
    """Recognition of action units by one classifier (Tables 3.3 and 3.4)."""
    rows = []
    for name, known in dependent.units.items():
        new = independent.units[name]
        rows.append(
            [
                *(name, THESIS_DEPENDENT[name], f"{100 * known.rate:.1f} of {known.shown}"),
                *(THESIS_INDEPENDENT[name], f"{100 * new.rate:.1f} of {new.shown}"),
                f"{100 * new.false / new.absent:.1f}",
                f"{independent.correlation[name]:.2f}" if name in independent.correlation else "-",
            ]
        )
    rates = f"{100 * dependent.rate:.1f}", f"{100 * independent.rate:.1f}"
    rows.append(
        ["all", 86.1, rates[0], 76.2, rates[1], f"{100 * independent.false_alarms:.1f}", "-"]
    )
    head = ["unit", "thesis, known people", "here, known", "thesis, new people", "here, new"]
    text = table([*head, "false alarms, new, %", "correlation, new"], rows)
    text += "\nFalse alarms, % of what is shown (thesis 1.7 and 4.4): known people "
    alarms = [f"{100 * each.false_of_shown:.1f}" for each in (dependent, independent)]
    return text + f"{alarms[0]}, new {alarms[1]}.\n"
