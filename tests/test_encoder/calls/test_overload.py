"""A live call that lags leaves out more and more, in the stated order; others nothing."""

from collections import Counter
from itertools import pairwise

import pytest

from encoder.calls.overload import (
    HOLD_OFF_S,
    LAG_LIMIT_S,
    LEVEL_DESCRIPTIONS,
    RESPONSE_S,
    OverloadController,
    overload_warning,
)
from encoder.live_model.pacing import MAX_CAMERA_LAG_S
from encoder.live_model.work_level import WorkLevel

PERIOD_S = 0.04
# What a frame takes at each level, of its period, where the call needs one level or another.
COSTS = {
    WorkLevel.HALF_THE_FRAMES: (1.3, 0.9, 0.8, 0.4),
    WorkLevel.NO_IMAGE_FIT: (1.6, 1.2, 0.9, 0.45),
    WorkLevel.HALF_RESOLUTION: (2.4, 1.8, 1.6, 0.8),
}


def levels_of(
    controller: OverloadController, costs: tuple[float, ...], frames: int
) -> list[WorkLevel]:
    """The level of each frame, if frames take these shares of their period, by level."""
    levels = []
    for _ in range(frames):
        levels.append(controller.level)
        controller.record_frame_time(costs[controller.level] * PERIOD_S)
    return levels


def test_frames_in_time_are_done_in_full() -> None:
    assert set(levels_of(OverloadController(PERIOD_S), (1.0,), 1000)) == {WorkLevel.FULL}


def test_a_call_that_need_not_keep_up_is_never_in_haste() -> None:
    controller = OverloadController(float("inf"))
    controller.record_frame_time(1e6)
    assert controller.level is WorkLevel.FULL and controller.may_refit(1e6, is_last=False)


def test_one_long_frame_is_no_overload() -> None:
    controller = OverloadController(PERIOD_S)
    for _ in range(100):
        controller.record_frame_time(PERIOD_S + 0.9 * LAG_LIMIT_S)
        for _ in range(4):
            controller.record_frame_time(PERIOD_S / 4)
        assert controller.level is WorkLevel.FULL


@pytest.mark.parametrize("needed", COSTS)
def test_a_call_goes_up_level_by_level_to_the_one_that_it_needs(needed: WorkLevel) -> None:
    levels = levels_of(OverloadController(PERIOD_S), COSTS[needed], 40)
    assert levels == sorted(levels)
    assert list(dict.fromkeys(levels)) == [level for level in WorkLevel if level <= needed]
    quickest = RESPONSE_S / PERIOD_S
    assert all(levels.count(level) >= quickest - 1 for level in WorkLevel if 0 < level < needed)


def test_a_call_that_has_caught_up_comes_back_level_by_level() -> None:
    controller = OverloadController(PERIOD_S)
    levels_of(controller, COSTS[WorkLevel.HALF_RESOLUTION], 60)
    levels = levels_of(controller, (0.5,) * len(WorkLevel), 200)
    assert levels == sorted(levels, reverse=True) and levels[-1] is WorkLevel.FULL
    for level in (WorkLevel.HALF_THE_FRAMES, WorkLevel.NO_IMAGE_FIT):
        assert abs(levels.count(level) * PERIOD_S - HOLD_OFF_S) <= 2 * PERIOD_S


def test_a_call_that_is_a_little_too_slow_is_in_haste_now_and_then() -> None:
    controller = OverloadController(PERIOD_S)
    levels = levels_of(controller, (1.05, 0.8, 0.7, 0.4), round(60 / PERIOD_S))
    assert max(levels) is WorkLevel.HALF_THE_FRAMES
    assert 0.25 < levels.count(WorkLevel.FULL) / len(levels) < 0.75


def test_the_lag_behind_a_camera_is_limited() -> None:
    controller = OverloadController(PERIOD_S, MAX_CAMERA_LAG_S)
    assert controller.record_frame_time(60.0) == MAX_CAMERA_LAG_S
    levels = levels_of(controller, (0.5,) * len(WorkLevel), round((HOLD_OFF_S + 1) / PERIOD_S))
    assert levels[-1] is WorkLevel.FULL and max(levels) is WorkLevel.HALF_THE_FRAMES


def test_a_call_that_can_never_keep_up_stays_at_the_last_level() -> None:
    levels = levels_of(OverloadController(PERIOD_S, MAX_CAMERA_LAG_S), (2.0,) * len(WorkLevel), 500)
    assert set(levels[100:]) == {WorkLevel.HALF_RESOLUTION}


def test_every_level_does_less_than_the_one_before() -> None:
    work = [
        (not level.halves_frames, level.fits_image, not level.halves_resolution)
        for level in WorkLevel
    ]
    assert all(
        sum(a > b for a, b in zip(more, less, strict=True)) == 1
        and sum(a < b for a, b in zip(more, less, strict=True)) == 0
        for more, less in pairwise(work)
    )
    iterations = [level.texel_iterations for level in WorkLevel]
    assert iterations == sorted(iterations, reverse=True) and iterations[0] > iterations[-1]


def test_the_warning_says_what_was_left_out_and_how_often() -> None:
    whole = Counter({WorkLevel.FULL: 9})
    assert overload_warning(whole, 0.0) is None and "2500 ms late" in str(
        overload_warning(whole, 2.5)
    )
    frames = Counter(dict(zip(WorkLevel, (51, 4, 3, 2), strict=True)))
    message = overload_warning(frames, 0.28)
    assert message is not None and "9 of 60 frames" in message and "280 ms late" in message
    parts = [
        f"{LEVEL_DESCRIPTIONS[level]} {count}" for level, count in sorted(frames.items()) if level
    ]
    assert message.endswith(", ".join(parts))
