"""Reports as a page: one file that opens without a network, its charts by Plotly."""

import platform
import sys
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from loopback.report import Cell, cell_text
from shared_model.errors import UserError

LIBRARIES = ("numpy", "opencv-python-headless", "av", "moderngl", "numba", "ai-edge-litert")
STYLE = (
    "body{font:15px/1.5 sans-serif;margin:2em auto;max-width:76em;padding:0 1em;color:#222}"
    "div.table{overflow-x:auto}"
    "td,th{padding:.2em .6em;text-align:right;border-bottom:1px solid #ddd}"
    "td:first-child,th:first-child{text-align:left}table{border-collapse:collapse}"
    "code{background:#f2f2f2;padding:.1em .3em;overflow-wrap:anywhere}"
)


def plotly_graphs() -> Any:
    """The module that makes figures.  Raises `UserError` if it is not installed."""
    try:
        import plotly.graph_objects
    except ImportError as error:
        raise UserError("charts need plotly: pip install '.[report]'") from error
    return plotly.graph_objects


def heading(text: str, level: int = 2) -> str:
    """A part of a page."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str) -> str:
    """A part of a page."""
    return f"<p>{escape(text)}</p>"


def html_table(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """A part of a page."""
    lines = [
        "<tr>" + "".join(f"<{tag}>{escape(cell_text(cell))}</{tag}>" for cell in row) + "</tr>"
        for tag, row in [("th", header), *(("td", row) for row in rows)]
    ]
    return f'<div class="table"><table>{"".join(lines)}</table></div>'


def chart(figure: Any) -> str:
    """A part of a page: a figure of Plotly."""
    figure.update_layout(template="plotly_white", font_size=13)
    hidden = {"displayModeBar": False}
    html: str = figure.to_html(full_html=False, include_plotlyjs=False, config=hidden)
    return html


def stacked_bars(
    names: Sequence[str], parts: Sequence[Mapping[str, float]], title: str, is_level: bool = False
) -> str:
    """A part of a page: a bar for each name, of its parts.  is_level: bars lie."""
    graphs = plotly_graphs()
    kinds = dict.fromkeys(kind for each in parts for kind in each)
    bars = []
    for kind in kinds:
        values = [each.get(kind, 0) for each in parts]
        across, up = (values, list(names)) if is_level else (list(names), values)
        bars.append(graphs.Bar(name=kind, x=across, y=up, orientation="h" if is_level else "v"))
    figure = graphs.Figure(bars)
    height = 160 + 40 * len(names) if is_level else 340
    figure.update_layout(barmode="stack", height=height, title=title)
    return chart(figure)


def environment() -> str:
    """A part of a page: the machine, the versions, and the command."""
    rows: list[list[Cell]] = [
        ["command", " ".join(["risorius", *sys.argv[1:]])],
        ["machine", f"{platform.machine()}, {platform.system()} {platform.release()}"],
        ["Python", platform.python_version()],
    ]
    for name in ("risorius", *LIBRARIES):
        try:
            rows.append([name, version(name)])
        except PackageNotFoundError:
            rows.append([name, None])
    return heading("Environment") + html_table(("", ""), rows)


def page(title: str, parts: Sequence[str]) -> bytes:
    """A page of these parts, with the library that draws its charts if it has some."""
    has_charts = any("plotly-graph-div" in part for part in parts)
    script = ""
    if has_charts:
        from plotly.offline import get_plotlyjs

        script = f"<script>{get_plotlyjs()}</script>"
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style>{script}<h1>{escape(title)}</h1>{''.join(parts)}</html>\n"
    ).encode()
