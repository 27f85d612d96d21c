"""Charts as SVG, by matplotlib, which is an extra."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from shared_model.arrays import Array, Indices, Picture
from shared_model.errors import UserError

# Okabe and Ito's colours.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
PANEL_INCHES = (4.0, 2.4)
NEEDED = "charts need matplotlib: pip install '.[figures]'"


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """label: for the legend, "" for none.  x, y: (n,), nan is a gap.  style: of matplotlib."""

    label: str
    x: Array | Indices
    y: Array
    style: str = "-"


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One plot.  lines: in the order of `COLOURS`.  bars: (x, heights) beneath them, or None.

    picture: (h, w, 3) uint8 BGR instead of all of these, without axes.
    """

    title: str
    x_label: str = ""
    y_label: str = ""
    lines: Sequence[Line] = ()
    bars: tuple[Array | Indices, Array] | None = None
    picture: Picture | None = None


def has_charts() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def chart_svg(
    panels: Sequence[Panel], columns: int = 3, size: tuple[float, float] = PANEL_INCHES
) -> str:
    """An SVG of panels in rows of `columns`; the same panels give the same text.

    size: inches of a panel.  Raises `UserError` if matplotlib is not installed.
    """
    if not has_charts():
        raise UserError(NEEDED)
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, each in zip(panels, axes, strict=False):
        each.set_title(panel.title, fontsize=9)
        if panel.picture is not None:
            each.imshow(np.ascontiguousarray(panel.picture[..., ::-1]))
            each.axis("off")
            continue
        if panel.bars is not None:
            each.bar(*panel.bars, color="#bbbbbb")
        for line, colour in zip(panel.lines, COLOURS, strict=False):
            each.plot(line.x, line.y, line.style, color=colour, label=line.label, linewidth=1)
        each.set_xlabel(panel.x_label, fontsize=8)
        each.set_ylabel(panel.y_label, fontsize=8)
        each.tick_params(labelsize=7)
        each.grid(alpha=0.3)
        if any(line.label for line in panel.lines):
            each.legend(fontsize=7)
    for each in axes[len(panels) :]:
        each.axis("off")
    text = io.StringIO()
    with rc_context({"svg.hashsalt": "risorius", "svg.fonttype": "none"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()
