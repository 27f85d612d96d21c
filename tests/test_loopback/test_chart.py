"""Charts: what is drawn lies where its numbers say, in both formats."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from loopback.chart import (
    COLOURS,
    HEIGHT,
    LEFT,
    RIGHT,
    WIDTH,
    Chart,
    Curve,
    Dot,
    Line,
    Mark,
    Text,
    layout,
    picture,
    svg,
    y_ticks,
)

CHART = Chart(
    "a < b",
    "bits",
    "dB",
    (200, 2000),
    (Curve("mean", ((200, 30.0), (2000, 36.5)), 4), Curve("one", ((500, 31.0),))),
)


def test_points_lie_by_the_logarithm_of_x_and_by_y() -> None:
    first, last, middle = (mark for mark in layout(CHART) if isinstance(mark, Dot))
    assert LEFT < first.centre[0] < middle.centre[0] < last.centre[0] < WIDTH - RIGHT
    share = (middle.centre[0] - first.centre[0]) / (last.centre[0] - first.centre[0])
    assert share == pytest.approx(np.log10(500 / 200))
    assert last.centre[1] < middle.centre[1] < first.centre[1] < HEIGHT
    assert (first.colour, middle.colour) == (COLOURS[0], COLOURS[1])


@pytest.mark.parametrize("values", [[30.0, 36.5], [31.2], [-3.0, 900.0], [35.0, 35.01]])
def test_ticks_are_round_and_enclose_all_values(values: list[float]) -> None:
    ticks = y_ticks(values)
    assert len(ticks) >= 2
    assert ticks[0] <= min(values) and max(values) <= ticks[-1]
    assert np.allclose(np.diff(ticks), ticks[1] - ticks[0])


def test_the_svg_is_well_formed_and_says_all_words() -> None:
    root = ElementTree.fromstring(svg(layout(CHART)))
    texts = {element.text for element in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"a < b", "bits", "dB", "mean", "one", "200", "2000"} <= texts
    assert len(list(root.iter("{http://www.w3.org/2000/svg}circle"))) == 3


def test_the_picture_shows_every_mark() -> None:
    marks: list[Mark] = [
        Line(((10, 10), (50, 10)), "#ff0000", 3),
        Dot((100, 100), "#00ff00"),
        Text((200, 200), "here", "middle"),
    ]
    image = picture(marks)
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert image[10, 30].tolist() == [0, 0, 255]
    assert image[100, 100].tolist() == [0, 255, 0]
    assert (image[180:210, 170:230] < 128).any() and image[300:, 300:].min() == 255


def test_a_chart_without_points_is_refused() -> None:
    with pytest.raises(ValueError, match="point"):
        layout(Chart("", "", "", (1,), (Curve("empty", ()),)))
