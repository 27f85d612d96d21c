"""How fast the model goes out, by what the link carries."""

import pytest

from encoder.coding.thin_link import startup_rate

FRAMES_BPS, PACKETS_PER_S = 800.0, 3.75


def rate(link_bps: float | None, limit_bps: float | None = None) -> float | None:
    return startup_rate(link_bps, limit_bps, FRAMES_BPS, PACKETS_PER_S)


@pytest.mark.parametrize("link_bps", [None, 64_000.0, 1e6])
def test_the_model_goes_whole_where_the_link_carries_it_or_is_not_known(
    link_bps: float | None,
) -> None:
    assert rate(link_bps) is None
    assert rate(link_bps, 8000.0) == 8000.0


def test_all_packets_with_their_headers_leave_room_on_a_thin_link() -> None:
    model_bps = (rate(9600.0) or 0.0) - FRAMES_BPS
    on_the_wire = 8 * 45 * PACKETS_PER_S + FRAMES_BPS + model_bps * (256 + 60) / 256
    assert model_bps > 2000 and on_the_wire == pytest.approx(0.7 * 9600)


def test_what_the_user_allows_is_the_most() -> None:
    assert rate(9600.0, 2000.0) == 2000.0
    assert (rate(9600.0, 50_000.0) or 0.0) < 9600


def test_the_thinnest_link_still_gets_a_model() -> None:
    assert (rate(1200.0) or 0.0) > FRAMES_BPS
