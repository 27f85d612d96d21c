"""A live call that falls behind its source hurries for a while, and one that keeps up does not."""

from encoder.calls.overload import HOLD_OFF_S, LAG_LIMIT_S, OverloadController

PERIOD_S = 0.04


def test_frames_in_time_leave_time() -> None:
    haste = OverloadController(PERIOD_S)
    for _ in range(1000):
        haste.record_frame_time(PERIOD_S)
        assert haste.has_headroom


def test_one_long_frame_is_made_up_for() -> None:
    haste = OverloadController(PERIOD_S)
    for _ in range(100):
        haste.record_frame_time(PERIOD_S + 0.9 * LAG_LIMIT_S)
        for _ in range(4):
            haste.record_frame_time(PERIOD_S / 4)
        assert haste.has_headroom


def test_who_falls_behind_hurries_for_a_while_after_catching_up() -> None:
    haste = OverloadController(PERIOD_S)
    for _ in range(13):
        assert haste.has_headroom
        haste.record_frame_time(1.2 * PERIOD_S)
    hurried = 0
    while not haste.has_headroom and hurried < 1000:
        haste.record_frame_time(PERIOD_S / 2)
        hurried += 1
    assert HOLD_OFF_S <= hurried * PERIOD_S <= HOLD_OFF_S + 2 * LAG_LIMIT_S + PERIOD_S


def test_a_long_halt_is_not_made_up_for_frame_by_frame() -> None:
    haste = OverloadController(PERIOD_S)
    haste.record_frame_time(60.0)
    for _ in range(round((HOLD_OFF_S + 1) / PERIOD_S)):
        haste.record_frame_time(PERIOD_S / 2)
    assert haste.has_headroom


def test_who_stays_behind_goes_on_hurrying() -> None:
    haste = OverloadController(PERIOD_S)
    for _ in range(30):
        haste.record_frame_time(1.2 * PERIOD_S)
    for _ in range(1000):
        haste.record_frame_time(1.1 * PERIOD_S)
        assert not haste.has_headroom
