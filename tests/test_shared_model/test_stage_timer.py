"""The time of stages and frames."""

import pytest

from shared_model.stage_timer import StageTimer, frame_times


def test_the_whole_is_all_stages_but_one() -> None:
    timer = StageTimer()
    timer.total_ns = {"draw": 5, "write": 7, "model": 2}
    assert timer.whole_ns("write") == 7 and timer.whole_ns("none") == 14


def test_times_of_frames() -> None:
    found = frame_times([*range(100), 1000])
    assert found == pytest.approx({"median": 50, "p95": 95, "worst": 1000})
    assert frame_times([]) == {}
