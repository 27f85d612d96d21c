"""Plots as SVG: what was predicted over what was displaced (Fig. 2.20 to 2.22), convergence."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from aam.charts import Line, Panel, chart_svg
from benchmarks.validate_aam.prediction_experiments import PredictionCurve
from shared_model.arrays import Array

SIDE, MARGIN = 190, 34
# Okabe and Ito's colours.
COLOURS = ("#0072b2", "#d55e00", "#009e73")
GRID, INK = "#cccccc", "#222222"


def prediction_plot(rows: Mapping[str, Sequence[PredictionCurve]], columns: int = 3) -> str:
    """An SVG with a panel for each parameter and a line for each contender, by its name: mean
    prediction, bars of one standard deviation.  The grey diagonal is exact.
    """
    names = list(dict.fromkeys(curve.name for curves in rows.values() for curve in curves))
    width = columns * (SIDE + MARGIN) + MARGIN
    height = -(-len(names) // columns) * (SIDE + 2 * MARGIN) + MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'font-family="sans-serif" font-size="11" fill="{INK}">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for number, name in enumerate(rows):
        x = MARGIN + 130 * number
        parts.append(f'<text x="{x}" y="16" fill="{COLOURS[number]}">{escape(name)}</text>')
    for number, name in enumerate(names):
        left = MARGIN + number % columns * (SIDE + MARGIN)
        top = MARGIN + number // columns * (SIDE + 2 * MARGIN)
        curves = {
            colour: curve
            for colour, own in zip(COLOURS, rows.values(), strict=False)
            for curve in own
            if curve.name == name
        }
        parts.append(f'<g transform="translate({left},{top})">{_panel(name, curves)}</g>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def convergence_chart(paths: Mapping[str, Sequence[Array]]) -> str:
    """An SVG of the mean distance by iteration (Fig. 3.1 to 3.3), a panel for each level.

    paths: by contender, of each level (iterations + 1,).  Raises `UserError`, see `chart_svg`.
    """
    levels = range(max(len(each) for each in paths.values()))
    panels = [
        Panel(
            f"level {number}",
            "iterations",
            "mean distance, % of the eyes'",
            [
                Line(name, np.arange(len(each[number])), 100 * each[number], "o-")
                for name, each in paths.items()
            ],
        )
        for number in levels
    ]
    return chart_svg(panels, columns=len(panels))


def _panel(name: str, curves: dict[str, PredictionCurve]) -> str:
    reach = max(float(np.abs(curve.actual).max()) for curve in curves.values()) * 1.1
    unit = next(iter(curves.values())).unit

    def at(x: float, y: float) -> str:
        inside = np.clip(y, -reach, reach)
        return f"{SIDE * (x + reach) / 2 / reach:.1f},{SIDE * (reach - inside) / 2 / reach:.1f}"

    parts = [
        f'<rect y="0" width="{SIDE}" height="{SIDE}" fill="none" stroke="{GRID}"/>',
        f'<path d="M{at(-reach, -reach)} L{at(reach, reach)} M{at(-reach, 0)} L{at(reach, 0)} '
        f'M{at(0, -reach)} L{at(0, reach)}" stroke="{GRID}"/>',
        f'<text y="{SIDE + 14}">{escape(name)}, {escape(unit)}, +-{reach / 1.1:.3g}</text>',
    ]
    for colour, curve in curves.items():
        points = " ".join(at(x, y) for x, y in zip(curve.actual, curve.mean, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}"/>')
        for x, y, deviation in zip(curve.actual, curve.mean, curve.predicted.std(1), strict=True):
            bar = f"M{at(x, y - deviation)} L{at(x, y + deviation)}"
            parts.append(f'<path d="{bar}" stroke="{colour}" stroke-opacity="0.5"/>')
    return "".join(parts)
