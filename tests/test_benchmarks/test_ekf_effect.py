"""The table and figure of actuators with and without the filter."""

import numpy as np
import pytest

from benchmarks.ekf_effect import LABELS, figure, restlessness, table_rows
from risorius.face_track import FaceTrack
from shared_model.arrays import Array
from shared_model.parameters import EAU_INDEX, EAUS


def tracked(jaw: Array) -> FaceTrack:
    eau = np.zeros((len(jaw), len(EAUS)))
    eau[:, EAU_INDEX["jaw_drop"]] = jaw
    return FaceTrack(np.arange(len(jaw)) / 25, np.zeros((len(jaw), 6)), eau, np.ones(len(jaw)))


def test_what_jumps_is_restless_and_what_goes_steadily_is_not() -> None:
    assert restlessness(np.linspace(0, 1, 9)) == pytest.approx(0)
    assert restlessness(np.array([0.0, 1.0, 0.0, 1.0])) == pytest.approx(2)
    assert restlessness(np.array([0.0, 1.0, 0.0, np.nan, 0.3])) == pytest.approx(2)


def test_a_line_has_the_statistics_of_the_frames_with_a_face() -> None:
    tracks = dict(zip(LABELS, (tracked(np.array([0.0, 0.5, 0.5, np.nan])),) * 2, strict=True))
    lines = table_rows("me.mp4", tracks, ["jaw_drop"])
    assert len(lines) == 2 and all(line.startswith("| me.mp4 | jaw_drop |") for line in lines)
    assert "| 3 | 0.000 | 0.500 | 0.333 | 0.236 |" in lines[0]


def test_the_figure_has_both_and_is_the_same_each_time() -> None:
    tracks = dict(zip(LABELS, (tracked(np.linspace(0, k, 20)) for k in (1, 2)), strict=True))
    drawn = figure(tracks, ["jaw_drop", "mouth_corners"])
    assert drawn == figure(tracks, ["jaw_drop", "mouth_corners"]) and "<svg" in drawn
