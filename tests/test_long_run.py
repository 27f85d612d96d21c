"""How a call's picture fares by minutes."""

import math

from scripts.long_run import summary


def test_minutes_and_what_is_after_the_beginning() -> None:
    # Two frames a second: a minute and a half, without a face for a moment.
    figures = [20.0] * 10 + [math.nan] * 10 + [30.0] * 100 + [32.0] * 60
    assert summary(figures, 2, after_s=10) == [
        "minute 1: 29.09 dB over 110 frames",
        "minute 2: 32.00 dB over 60 frames",
        "after 10 s: 30.75 dB over 160 frames",
        "last minute against the first: +1.91 dB",
    ]


def test_a_call_that_ends_before_says_so() -> None:
    assert summary([25.0] * 4, 2, after_s=5)[1] == "after 5 s: nan dB over 0 frames"
