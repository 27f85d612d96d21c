"""A live call that lags behind its source is overloaded for a while, one that keeps up is not."""

from encoder.calls.overload import HOLD_OFF_S, LAG_LIMIT_S, OverloadController

PERIOD_S = 0.04


def test_frames_in_time_leave_headroom() -> None:
    controller = OverloadController(PERIOD_S)
    for _ in range(1000):
        controller.record_frame_time(PERIOD_S)
        assert controller.has_headroom


def test_one_long_frame_is_no_overload() -> None:
    controller = OverloadController(PERIOD_S)
    for _ in range(100):
        controller.record_frame_time(PERIOD_S + 0.9 * LAG_LIMIT_S)
        for _ in range(4):
            controller.record_frame_time(PERIOD_S / 4)
        assert controller.has_headroom


def test_a_call_that_lags_is_overloaded_for_a_while_after_catching_up() -> None:
    controller = OverloadController(PERIOD_S)
    for _ in range(13):
        assert controller.has_headroom
        controller.record_frame_time(1.2 * PERIOD_S)
    overloaded_frames = 0
    while not controller.has_headroom and overloaded_frames < 1000:
        controller.record_frame_time(PERIOD_S / 2)
        overloaded_frames += 1
    assert HOLD_OFF_S <= overloaded_frames * PERIOD_S <= HOLD_OFF_S + 2 * LAG_LIMIT_S + PERIOD_S


def test_the_lag_of_a_long_halt_is_limited() -> None:
    controller = OverloadController(PERIOD_S)
    controller.record_frame_time(60.0)
    for _ in range(round((HOLD_OFF_S + 1) / PERIOD_S)):
        controller.record_frame_time(PERIOD_S / 2)
    assert controller.has_headroom


def test_a_call_that_goes_on_lagging_stays_overloaded() -> None:
    controller = OverloadController(PERIOD_S)
    for _ in range(30):
        controller.record_frame_time(1.2 * PERIOD_S)
    for _ in range(1000):
        controller.record_frame_time(1.1 * PERIOD_S)
        assert not controller.has_headroom
