"""Curves over a logarithmic axis, as SVG and as a picture.

A chart is first laid out as a list of marks, in pixels, that both formats then draw.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log
from xml.sax.saxutils import escape

import cv2
import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]

WIDTH, HEIGHT = 960, 600
LEFT, RIGHT, TOP, BOTTOM = 80, 190, 50, 70
TEXT_PX = 15
# Okabe and Ito's colours, told apart by colour-blind eyes too; black comes first.
COLOURS = (
    *("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f00"),
    "#808080",
)
GRID = "#dddddd"
INK = "#222222"
# How far apart the lines of the grid may be, in units of y, and how many there are at most.
STEPS = (0.5, 1, 2, 5, 10, 20)
MOST_LINES = 10


@dataclass(frozen=True, slots=True)
class Curve:
    """A named line through points (x > 0, y), in order of x."""

    name: str
    points: tuple[Point, ...]
    width_px: int = 2


@dataclass(frozen=True, slots=True)
class Chart:
    """What to draw; x_ticks: where the x axis has numbers."""

    title: str
    x_label: str
    y_label: str
    x_ticks: tuple[float, ...]
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Line:
    """Straight from point to point, pixels."""

    points: tuple[Point, ...]
    colour: str
    width_px: int = 1


@dataclass(frozen=True, slots=True)
class Dot:
    """A filled circle, pixels."""

    centre: Point
    colour: str
    radius_px: int = 4


@dataclass(frozen=True, slots=True)
class Text:
    """Words whose baseline starts, is centred or ends at a place, pixels."""

    place: Point
    words: str
    anchor: str = "start"
    colour: str = INK


Mark = Line | Dot | Text


def layout(chart: Chart) -> list[Mark]:
    """The marks that make up a chart.  Raises `ValueError` if it has no points."""
    points = [point for curve in chart.curves for point in curve.points]
    if not points:
        raise ValueError("a chart needs a point")
    ticks = y_ticks([y for _, y in points])
    x_range = _range([x for x, _ in points] + list(chart.x_ticks))

    def place(x: float, y: float) -> Point:
        across = log(x / x_range[0]) / log(x_range[1] / x_range[0])
        up = (y - ticks[0]) / (ticks[-1] - ticks[0])
        return (
            LEFT + across * (WIDTH - LEFT - RIGHT),
            HEIGHT - BOTTOM - up * (HEIGHT - TOP - BOTTOM),
        )

    marks: list[Mark] = [
        Text((LEFT, TOP - 20), chart.title),
        Text(((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 20), chart.x_label, "middle"),
        Text((8, TOP - 20), chart.y_label),
    ]
    for tick in ticks:
        left, right = place(x_range[0], tick), place(x_range[1], tick)
        marks += [Line((left, right), GRID), Text((LEFT - 8, left[1] + 5), f"{tick:g}", "end")]
    for tick in chart.x_ticks:
        low, high = place(tick, ticks[0]), place(tick, ticks[-1])
        marks += [Line((low, high), GRID), Text((low[0], low[1] + 22), f"{tick:g}", "middle")]
    for number, curve in enumerate(chart.curves):
        colour = COLOURS[number % len(COLOURS)]
        there = tuple(place(x, y) for x, y in curve.points)
        legend = TOP + 10 + 24 * number
        legend_x = WIDTH - RIGHT + 20
        marks += [Line(there, colour, curve.width_px), *(Dot(at, colour) for at in there)]
        marks += [
            Line(((legend_x, legend), (legend_x + 24, legend)), colour, curve.width_px),
            Text((legend_x + 32, legend + 5), curve.name),
        ]
    return marks


def y_ticks(values: Sequence[float]) -> list[float]:
    """Round numbers around all values, evenly spaced; at least two."""
    low, high = min(values), max(values)
    step = next((s for s in STEPS if (high - low) / s <= MOST_LINES - 2), STEPS[-1])
    first, last = floor(low / step), ceil(high / step)
    return [step * n for n in range(first, max(last, first + 1) + 1)]


def svg(marks: Sequence[Mark]) -> str:
    """The marks as an SVG file."""
    body = "\n".join(map(_svg_mark, marks))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"'
        f' font-family="sans-serif" font-size="{TEXT_PX}">\n'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


def picture(marks: Sequence[Mark]) -> NDArray[np.uint8]:
    """The marks as a picture, (HEIGHT, WIDTH, 3) uint8 BGR."""
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    for mark in marks:
        colour = _bgr(mark.colour)
        if isinstance(mark, Line):
            corners = np.rint(np.array(mark.points)).astype(np.int32)
            cv2.polylines(image, [corners], False, colour, mark.width_px, cv2.LINE_AA)
        elif isinstance(mark, Dot):
            centre = (round(mark.centre[0]), round(mark.centre[1]))
            cv2.circle(image, centre, mark.radius_px, colour, -1, cv2.LINE_AA)
        else:
            _write(image, mark, colour)
    return image


def _write(image: NDArray[np.uint8], text: Text, colour: tuple[int, int, int]) -> None:
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, TEXT_PX / 32
    (width, _), _ = cv2.getTextSize(text.words, font, scale, 1)
    shift = {"start": 0, "middle": width / 2, "end": width}[text.anchor]
    place = (round(text.place[0] - shift), round(text.place[1]))
    cv2.putText(image, text.words, place, font, scale, colour, 1, cv2.LINE_AA)


def _svg_mark(mark: Mark) -> str:
    if isinstance(mark, Line):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in mark.points)
        return (
            f'<polyline points="{points}" fill="none" stroke="{mark.colour}"'
            f' stroke-width="{mark.width_px}"/>'
        )
    if isinstance(mark, Dot):
        x, y = mark.centre
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{mark.radius_px}" fill="{mark.colour}"/>'
    x, y = mark.place
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{mark.anchor}" fill="{mark.colour}">'
        f"{escape(mark.words)}</text>"
    )


def _range(values: Sequence[float]) -> Point:
    """From a little below the least to a little above the greatest, never empty."""
    return min(values) / 1.08, max(values) * 1.08


def _bgr(colour: str) -> tuple[int, int, int]:
    return int(colour[5:7], 16), int(colour[3:5], 16), int(colour[1:3], 16)
