"""Which pictures are left out where a host cannot draw them all."""

from risorius.live_call.thinning import Thinning

FPS, PACKED = 25.0, 8
PACKET_S = PACKED / FPS


def drawn(draw_s: float, seconds: float, fps: float | None = None) -> tuple[list[int], float]:
    """The frames that are drawn of a call whose packets come in time, and the last one's lag.

    draw_s: time that a picture takes.
    """
    now_s, found = 0.0, list[int]()
    thinning = Thinning(fps, lambda: now_s)
    for index in range(round(seconds * FPS)):
        arrival_s = (index // PACKED + 1) * PACKET_S
        now_s = max(now_s, arrival_s)
        thinning.arrival_s = arrival_s
        if thinning.wants(index, FPS):
            now_s += draw_s
            found.append(index)
    return found, now_s - seconds


def test_a_host_that_is_quick_enough_draws_all() -> None:
    assert drawn(0.02, 20.0)[0] == list(range(500))


def test_a_host_that_is_too_slow_draws_what_it_can_and_does_not_come_ever_later() -> None:
    for draw_s in (0.06, 0.15, 0.25):
        frames, lag_s = drawn(draw_s, 60.0)
        assert lag_s < PACKET_S + draw_s + 0.1
        # No less than half of what it could.
        assert len(frames) > 0.5 * 60 / draw_s


def test_who_wants_fewer_pictures_gets_them_evenly() -> None:
    frames, _ = drawn(0.01, 8.0, fps=8.0)
    assert frames == list(range(0, 200, 3))


def test_what_has_waited_while_nothing_could_be_drawn_is_caught_up_with() -> None:
    now_s, drawn_s = 12.0, 0.03
    thinning = Thinning(None, lambda: now_s)
    for index in range(round(40 * FPS)):
        thinning.arrival_s = (index // PACKED + 1) * PACKET_S
        now_s = max(now_s, thinning.arrival_s)
        if thinning.wants(index, FPS):
            now_s += drawn_s
    assert now_s - 40 < PACKET_S + 0.1
