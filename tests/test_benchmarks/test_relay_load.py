"""The measurement of relays: what it counts is what was sent."""

from benchmarks.relay_load.__main__ import measure


def test_what_subscribers_have_through_two_relays_is_what_was_sent() -> None:
    figures = measure(2, subscribers=2, relays=2, seconds=0.7, scheme="tcp", patience_s=30)
    assert 0 < figures["share"] <= 1  # type: ignore[operator]
    assert len(figures["relay_cores"]) == 2  # type: ignore[arg-type]
    assert figures["relay_mb"] > 1  # type: ignore[operator]
