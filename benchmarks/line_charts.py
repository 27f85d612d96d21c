"""Line charts of ground truth and estimates over time, as in Fig. 5.6/5.7, drawn with OpenCV."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

WIDTH, HEIGHT = 800, 160
LEFT, RIGHT, TOP, BOTTOM = 64, 12, 26, 20
INK, GRID = (70, 70, 70), (225, 225, 225)
# BGR of the curves in their order; the ground truth comes first, wide and grey.
COLOURS = ((175, 175, 175), (180, 90, 20), (40, 110, 220))
WIDTHS = (4, 1, 1)
# Few grey levels keep the files small without a visible loss.
GREY_STEP = 51


@dataclass(frozen=True, slots=True)
class Chart:
    """A panel: title and curves over common times."""

    title: str
    curves: Sequence[Array]


def draw_charts(charts: Sequence[Chart], time_s: Array, names: Sequence[str]) -> Picture:
    """The panels one above the other, (h, w, 3) uint8 BGR.  names: of the curves."""
    panels = [_panel(chart, time_s) for chart in charts]
    picture = np.concatenate([_legend(names), *panels])
    return np.asarray(np.rint(picture / GREY_STEP) * GREY_STEP, np.uint8)


def _panel(chart: Chart, time_s: Array) -> Picture:
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    values = np.concatenate([c[np.isfinite(c)] for c in chart.curves])
    low, high = float(values.min()), float(values.max())
    margin = 0.05 * max(high - low, 1e-6)
    low, high = low - margin, high + margin

    def to_pixels(t: Array, value: Array) -> NDArray[np.int32]:
        x = LEFT + (WIDTH - LEFT - RIGHT) * (t - time_s[0]) / (time_s[-1] - time_s[0])
        y = HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - low) / (high - low)
        return np.asarray(np.rint(16 * np.stack([x, y], -1)), np.int32)

    for tick in _ticks(low, high):
        ends = to_pixels(time_s[[0, -1]], np.full(2, tick))
        cv2.line(image, ends[0].tolist(), ends[1].tolist(), GRID, 1, cv2.LINE_AA, 4)
        _write(image, f"{tick:g}", (8, int(ends[0, 1] / 16) + 4))
    for tick in _ticks(float(time_s[0]), float(time_s[-1])):
        at = to_pixels(np.array([tick]), np.array([low]))[0]
        _write(image, f"{tick:g} s", (int(at[0] / 16) - 8, HEIGHT - 5))
    for curve, colour, width in zip(chart.curves, COLOURS, WIDTHS, strict=False):
        finite = np.isfinite(curve)
        for run in np.split(
            np.flatnonzero(finite), np.flatnonzero(np.diff(np.flatnonzero(finite)) > 1) + 1
        ):
            cv2.polylines(
                image, [to_pixels(time_s[run], curve[run])], False, colour, width, cv2.LINE_AA, 4
            )
    _write(image, chart.title, (LEFT, 17))
    return image


def _legend(names: Sequence[str]) -> Picture:
    image = np.full((26, WIDTH, 3), 255, np.uint8)
    x = LEFT
    for name, colour, width in zip(names, COLOURS, WIDTHS, strict=False):
        cv2.line(image, (x, 13), (x + 28, 13), colour, width, cv2.LINE_AA)
        _write(image, name, (x + 36, 17))
        x += 60 + 8 * len(name)
    return image


def _ticks(low: float, high: float) -> list[float]:
    """About four round numbers between `low` and `high`."""
    raw = (high - low) / 4
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(s for s in (1, 2, 2.5, 5, 10) if s * power >= raw)
    return [
        round(float(t), 9) + 0.0 for t in np.arange(np.ceil(low / step), high / step + 1e-9) * step
    ]


def _write(image: Picture, text: str, at: tuple[int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, INK, 1, cv2.LINE_AA)
