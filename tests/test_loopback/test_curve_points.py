"""Curves of rate and quality: their points, where they cross, Bjontegaard's mean."""

import numpy as np
import pytest

from loopback.curves.curve_bench import (
    OURS,
    CurveSettings,
    duel_rows,
    duels,
    geometric_mean_kbps,
)
from loopback.curves.curve_page import mean_curve
from loopback.curves.points import Curve, Point, bd_rate_percent, crossing_bps, curve_of

MEASURE = "face_psnr_db"


def point(start: int, bps: float, quality: float | None, label: str = "") -> Point:
    return Point(label, start, bps, {MEASURE: quality})


def curve(*pairs: tuple[float, float]) -> Curve:
    rates, qualities = np.array(pairs).T
    return Curve(rates, qualities)


def test_the_start_counts_less_in_a_longer_call() -> None:
    one = point(1000, 500, 30)
    assert one.total_bps(10) == 1300
    assert one.total_bps(600) == pytest.approx(513.3, abs=0.1)
    assert one.total_bps(0) == 500


def test_points_that_cost_more_and_give_less_are_left_out() -> None:
    points = [point(0, 100, 30), point(0, 200, 29), point(0, 300, 33), point(0, 400, None)]
    found = curve_of(points, MEASURE, 0)
    assert found.rates.tolist() == [100, 300] and found.qualities.tolist() == [30, 33]
    assert len(curve_of([], MEASURE, 0).rates) == 0


def test_between_points_the_logarithm_of_the_rate_counts() -> None:
    line = curve((100, 30), (10_000, 40))
    assert line.quality_at(1000) == pytest.approx(35)
    assert line.quality_at(50) == -np.inf and line.quality_at(1e6) == 40
    assert line.rate_for(35) == pytest.approx(1000)
    assert line.rate_for(20) == 100 and line.rate_for(41) is None
    nothing = Curve(np.zeros(0), np.zeros(0))
    assert nothing.quality_at(5) == -np.inf and nothing.rate_for(5) is None


def test_curves_cross_where_the_other_stays_above() -> None:
    ours = curve((300, 33), (1000, 36))
    theirs = curve((3000, 28), (100_000, 40))
    rate = crossing_bps(ours, theirs)
    assert rate is not None
    assert theirs.quality_at(rate) == pytest.approx(36, abs=0.1)
    assert crossing_bps(ours, curve((3000, 28), (9000, 35))) is None
    assert crossing_bps(ours, curve((400, 40), (900, 44))) == pytest.approx(400)
    assert crossing_bps(ours, Curve(np.zeros(0), np.zeros(0))) is None


def test_twice_the_bits_for_equal_quality_is_100_percent() -> None:
    ours = curve((100, 30), (1000, 36), (5000, 40))
    twice = Curve(2 * ours.rates, ours.qualities)
    assert bd_rate_percent(ours, twice) == pytest.approx(100)
    assert bd_rate_percent(twice, ours) == pytest.approx(-50)
    assert bd_rate_percent(ours, curve((9, 50), (99, 60))) is None
    assert bd_rate_percent(ours, curve((9, 35))) is None


def test_a_mean_begins_where_all_have_a_point() -> None:
    mean = mean_curve([curve((100, 30), (1000, 34)), curve((200, 20), (4000, 28))])
    assert mean.rates[0] == pytest.approx(200) and mean.rates[-1] == pytest.approx(4000)
    assert mean.qualities[-1] == pytest.approx(31)
    assert len(mean_curve([curve((1, 1)), Curve(np.zeros(0), np.zeros(0))]).rates) == 0


def test_a_duel_says_what_the_rival_needs_and_where_it_overtakes() -> None:
    clips = {
        name: {
            OURS: [point(10_000, 800, 34, "800 bit/s")],
            "x264": [point(2000, 9000, 30), point(3000, 40_000, 38)],
        }
        for name in ("a", "b")
    }
    found = duels(clips, "800 bit/s")
    assert {duel.clip for duel in found} == {"a", "b"}
    header, rows = duel_rows(found, 0)
    (row,) = rows
    assert header[0] == "rival" and row[:4] == ["x264", MEASURE, 2, "0.80"]
    assert isinstance(row[4], str) and 9 < float(row[4]) < 40
    assert float(str(row[5])) == pytest.approx(float(row[4]), rel=0.1)
    assert geometric_mean_kbps([4000.0, 9000.0], [1, 1]) == "6.00"
    assert geometric_mean_kbps([4000.0, None], [9000.0, 36_000.0]) == "> 12.0"
    assert geometric_mean_kbps([None], [0.0]) is None
    assert CurveSettings((), ()).is_live is False
