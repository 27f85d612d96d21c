"""The page of a bench of curves."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loopback.curves.curve_bench import OURS, Contenders, Duel, duel_rows, point_rows
from loopback.curves.exhibits import Exhibit
from loopback.curves.points import DURATIONS_S, MEASURES, Curve, curve_of
from loopback.report_page import (
    chart,
    environment,
    heading,
    html_table,
    page,
    paragraph,
    plotly_graphs,
    stacked_bars,
)

TITLES = {
    "face_psnr_db": "PSNR of the face, dB",
    "face_ssimulacra2": "SSIMULACRA2 of the face",
    "full_psnr_db": "PSNR of the picture, dB",
    "picture_ssimulacra2": "SSIMULACRA2 of the picture",
}
# Figures of our rungs that have parts.
BARS = {"groups": "bytes of frame packets by group", "stage_ms": "encoder, ms a frame by stage"}
COLOURS = ("#d1495b", "#00798c", "#edae49", "#5c677d", "#66a182", "#8e5572")
# Where a mean over clips is drawn, points a decade.
STEPS_PER_DECADE = 30
# The call whose curves are shown first, s.
FIRST_SHOWN_S = 60.0


def curve_page(
    clips: Mapping[str, Contenders],
    duels: Sequence[Duel],
    exhibits: Mapping[str, Sequence[Exhibit]],
    judge: str,
) -> bytes:
    """The report of a bench, see `bench_curves`.  exhibits: of each clip, the source first."""
    go = plotly_graphs()
    parts = [
        paragraph(
            f"Face and person found in the source by: {judge}. A rate is that of a whole call,"
            " its model or first frame included, of the length that is chosen."
        ),
        heading("What a rival needs for our quality"),
        html_table(*duel_rows(duels, FIRST_SHOWN_S)),
    ]
    if len(clips) > 1:
        parts += [heading(f"Mean of {len(clips)} clips"), chart(mean_figure(go, clips))]
    parts += [heading("Our rungs"), html_table(*point_rows(clips))]
    for name, contenders in clips.items():
        parts += [heading(name), chart(curve_figure(go, contenders))]
        if shown := exhibits.get(name):
            parts += [chart(pictures_figure(go, shown)), chart(time_figure(go, shown[1:]))]
        ours = contenders[OURS]
        labels = [point.label for point in ours]
        for figure, title in BARS.items():
            parts.append(stacked_bars(labels, [p.figures.get(figure, {}) for p in ours], title))
    return page("risorius bench: curves", [*parts, environment()])


def curve_figure(go: Any, contenders: Contenders) -> Any:
    """Quality over rate of each codec, by four measures; a button for each length of a call."""
    curves = {
        duration: {
            codec: {m: curve_of(points, m, duration) for m in MEASURES}
            for codec, points in contenders.items()
        }
        for duration in DURATIONS_S
    }
    return _curves_figure(go, curves)


def mean_figure(go: Any, clips: Mapping[str, Contenders]) -> Any:
    """The same, mean over the clips, where all have a point."""
    codecs = [c for c in next(iter(clips.values())) if all(c in each for each in clips.values())]
    curves = {
        duration: {
            codec: {
                measure: mean_curve([curve_of(e[codec], measure, duration) for e in clips.values()])
                for measure in MEASURES
            }
            for codec in codecs
        }
        for duration in DURATIONS_S
    }
    return _curves_figure(go, curves)


def mean_curve(curves: Sequence[Curve]) -> Curve:
    """The mean of the qualities at equal rates, from the rate on at which all have a point."""
    if not all(len(curve.rates) for curve in curves):
        return Curve(np.zeros(0), np.zeros(0))
    low = max(curve.rates[0] for curve in curves)
    high = max(low, *(curve.rates[-1] for curve in curves))
    count = max(2, round(np.log10(high / low) * STEPS_PER_DECADE) + 1)
    rates = np.geomspace(low, high, count)
    return Curve(rates, np.mean([curve.quality_at(rates) for curve in curves], axis=0))


def _curves_figure(go: Any, curves: Mapping[float, Mapping[str, Mapping[str, Curve]]]) -> Any:
    from plotly.subplots import make_subplots

    figure = make_subplots(2, 2, subplot_titles=[TITLES[measure] for measure in MEASURES])
    lengths: list[float] = []
    for duration, by_codec in curves.items():
        for codec, colour in zip(by_codec, COLOURS, strict=False):
            for place, measure in enumerate(MEASURES):
                curve = by_codec[codec][measure]
                line = go.Scatter(
                    x=(curve.rates / 1000).tolist(),
                    y=curve.qualities.tolist(),
                    name=codec,
                    legendgroup=codec,
                    showlegend=place == 0,
                    mode="lines+markers" if len(curve.rates) < STEPS_PER_DECADE else "lines",
                    line={"color": colour, "width": 3 if codec == OURS else 1.5},
                    visible=duration == FIRST_SHOWN_S,
                )
                figure.add_trace(line, place // 2 + 1, place % 2 + 1)
                lengths.append(duration)
    buttons = [
        {
            "label": f"{duration:g} s" if duration else "after the start",
            "method": "update",
            "args": [{"visible": [length == duration for length in lengths]}],
        }
        for duration in curves
    ]
    active = list(curves).index(FIRST_SHOWN_S) if FIRST_SHOWN_S in curves else 0
    menu = {"type": "buttons", "direction": "right", "buttons": buttons, "active": active}
    figure.update_layout(height=760, updatemenus=[{**menu, "x": 0, "y": 1.12, "xanchor": "left"}])
    figure.update_xaxes(type="log", title_text="kbit/s")
    return figure


def pictures_figure(go: Any, exhibits: Sequence[Exhibit]) -> Any:
    """Source and codecs side by side, errors below; a slider for the time."""
    from plotly.subplots import make_subplots

    count, times = len(exhibits), len(exhibits[0].pictures)
    figure = make_subplots(
        2,
        count,
        subplot_titles=[each.title for each in exhibits],
        horizontal_spacing=0.005,
        vertical_spacing=0.01,
    )
    moments: list[int] = []
    for moment in range(times):
        for column, each in enumerate(exhibits, 1):
            for row, pictures in enumerate((each.pictures, each.errors), 1):
                if moment < len(pictures):
                    image = go.Image(source=pictures[moment], visible=moment == 0, hoverinfo="skip")
                    figure.add_trace(image, row, column)
                    moments.append(moment)
    steps = [
        {
            "label": str(moment + 1),
            "method": "update",
            "args": [{"visible": [each == moment for each in moments]}],
        }
        for moment in range(times)
    ]
    slider = {"steps": steps, "currentvalue": {"prefix": f"picture, of {times}: "}}
    figure.update_layout(height=560, sliders=[slider], margin={"l": 10, "r": 10, "t": 40})
    figure.update_annotations(font_size=11)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    return figure


def time_figure(go: Any, exhibits: Sequence[Exhibit]) -> Any:
    """PSNR of the face and what has been sent, over time."""
    from plotly.subplots import make_subplots

    titles = ["PSNR of the face, dB, by frame", "sent so far, kB, by second"]
    figure = make_subplots(1, 2, subplot_titles=titles)
    for each, colour in zip(exhibits, COLOURS, strict=False):
        common = {"name": each.title, "legendgroup": each.title, "line": {"color": colour}}
        psnr = go.Scatter(y=list(each.face_psnr_db), mode="lines", **common)
        figure.add_trace(psnr, 1, 1)
        seconds, sent = [pair[0] for pair in each.kilobytes], [pair[1] for pair in each.kilobytes]
        bits = go.Scatter(x=seconds, y=sent, mode="lines", showlegend=False, **common)
        figure.add_trace(bits, 1, 2)
    figure.update_layout(height=360)
    return figure
