"""A page's times: as it says, unless its clock or this host's has been set."""

import pytest

from risorius.call_page.page_clock import MAX_AWAY_S, PageClock

START_S, SINCE_1970_S = 100.0, 1.8e9


class Clocks:
    """This host's clocks; `set_by_s`: how far that since 1970 has been set."""

    def __init__(self) -> None:
        self.now_s = START_S

    def page(self) -> PageClock:
        return PageClock(lambda: self.now_s, lambda: SINCE_1970_S)


def test_a_pages_times_are_those_of_this_host() -> None:
    clocks = Clocks()
    page = clocks.page()
    clocks.now_s += 60
    sent_ms = 1000 * (SINCE_1970_S + 59.5)
    assert page.taken_s(sent_ms) == pytest.approx(START_S + 59.5)
    assert page.page_ms(START_S + 59.5) == pytest.approx(sent_ms)


@pytest.mark.parametrize("set_by_s", [-3600.0, -2 * MAX_AWAY_S, 2 * MAX_AWAY_S, 1e300])
def test_after_the_clock_was_set_times_go_on_from_now(set_by_s: float) -> None:
    clocks = Clocks()
    page = clocks.page()
    clocks.now_s += 60
    assert page.taken_s(1000 * (SINCE_1970_S + set_by_s + 60)) == pytest.approx(START_S + 60)
    if abs(set_by_s) < 1e9:
        clocks.now_s += 1
        sent_ms = 1000 * (SINCE_1970_S + set_by_s + 60.96)
        assert page.taken_s(sent_ms) == pytest.approx(START_S + 60.96, abs=1e-3)
