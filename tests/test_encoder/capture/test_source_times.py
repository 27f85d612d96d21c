"""Frame times: which rates are constant, and the deviations of one that varies."""

from fractions import Fraction

import numpy as np
import pytest

from encoder.capture.frame_times import FrameTimes, frame_times
from protocol.frames.frame_times import FrameClock
from protocol.limits import MAX_TIMED_FRAMES

FPS = Fraction(30000, 1001)


def test_even_times_keep_the_stated_rate_whatever_their_order_and_rounding() -> None:
    exact = [frame / FPS for frame in range(40)]
    rounded = [Fraction(round(1000 * time_s), 1000) for time_s in exact]
    for times_s in (exact, rounded, rounded[::-1], [time_s + 7 for time_s in exact]):
        assert frame_times(times_s, FPS) == FrameTimes(FPS)


def test_even_times_overrule_a_wrong_stated_rate() -> None:
    assert frame_times([Fraction(n, 12) for n in range(50)], Fraction(25)).fps == 12


@pytest.mark.parametrize("times_s", [[], [Fraction(3)], [Fraction(0), Fraction(1), Fraction(1)]])
def test_times_that_say_nothing_leave_the_stated_rate(times_s: list[Fraction]) -> None:
    assert frame_times(times_s, FPS) == FrameTimes(FPS)


def test_uneven_times_are_those_that_a_receiver_finds() -> None:
    rng = np.random.default_rng(1)
    steps = rng.choice([1, 1, 1, 5, 40], 150)
    shown_s = [Fraction(int(n), 30) for n in np.concatenate([[0], np.cumsum(steps)])]
    times, clock = frame_times(shown_s, Fraction(30)), FrameClock()
    for first in range(0, len(shown_s), MAX_TIMED_FRAMES):
        packet = times.packet(first)
        assert packet is not None
        clock.receive(packet)
    assert times.packet(len(shown_s)) is None
    assert float(times.fps) == pytest.approx(150 / float(shown_s[-1]), rel=1e-4)
    for frame, time_s in enumerate(shown_s):
        # Half a tick, and what the frame before needs if it comes too late.
        away_s = abs(float(clock.time_s(frame, times.fps) - time_s))
        assert away_s <= 1 / 16 / float(times.fps)
        assert times.time_s(frame) == pytest.approx(float(time_s), abs=1 / 16 / float(times.fps))


def test_frames_never_share_a_time() -> None:
    shown_s = [Fraction(n, 1000) for n in (0, 1, 2, 3, 900, 901, 2000)]
    times = frame_times(shown_s, Fraction(25))
    shown = [times.time_s(frame) for frame in range(len(shown_s))]
    assert np.all(np.diff(shown) > 0)
