"""A live call that falls behind its source hurries for a while, and one that keeps up does not."""

from encoder.calls.overload import BEHIND_S, RESTING_S, Haste

PERIOD_S = 0.04


def test_frames_in_time_leave_time() -> None:
    haste = Haste(PERIOD_S)
    for _ in range(1000):
        haste.spent(PERIOD_S)
        assert haste.has_time


def test_one_long_frame_is_made_up_for() -> None:
    haste = Haste(PERIOD_S)
    for _ in range(100):
        haste.spent(PERIOD_S + 0.9 * BEHIND_S)
        for _ in range(4):
            haste.spent(PERIOD_S / 4)
        assert haste.has_time


def test_who_falls_behind_hurries_for_a_while_after_catching_up() -> None:
    haste = Haste(PERIOD_S)
    for _ in range(13):
        assert haste.has_time
        haste.spent(1.2 * PERIOD_S)
    hurried = 0
    while not haste.has_time and hurried < 1000:
        haste.spent(PERIOD_S / 2)
        hurried += 1
    assert RESTING_S <= hurried * PERIOD_S <= RESTING_S + 2 * BEHIND_S + PERIOD_S


def test_a_long_halt_is_not_made_up_for_frame_by_frame() -> None:
    haste = Haste(PERIOD_S)
    haste.spent(60.0)
    for _ in range(round((RESTING_S + 1) / PERIOD_S)):
        haste.spent(PERIOD_S / 2)
    assert haste.has_time


def test_who_stays_behind_goes_on_hurrying() -> None:
    haste = Haste(PERIOD_S)
    for _ in range(30):
        haste.spent(1.2 * PERIOD_S)
    for _ in range(1000):
        haste.spent(1.1 * PERIOD_S)
        assert not haste.has_time
