"""The measurement of relays: what it counts is what was sent."""

from scripts.relay_load.__main__ import measure


def test_through_two_relays_each_subscriber_has_every_packet() -> None:
    figures = measure(calls=2, subscribers=2, relays=2, seconds=0.7, scheme="tcp")
    assert figures["share"] == 1.0
    assert len(figures["relay_cores"]) == 2  # type: ignore[arg-type]
    assert figures["relay_mb"] > 1  # type: ignore[operator]
