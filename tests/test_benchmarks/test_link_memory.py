"""The long call of `benchmarks.link_memory`, for a minute: its packets arrive and are shown."""

from pathlib import Path

from layer_streams import write_call

from benchmarks.link_memory.__main__ import long_call, memory_mb


def test_a_minute_of_a_long_call_arrives(tmp_path: Path) -> None:
    write_call(tmp_path / "call.rzo", 20)
    call = long_call(tmp_path / "call.rzo", loss=0.1)
    for _ in call.minutes(1):
        assert memory_mb() > 1
    # One frame packet each 8 / 29.97 s, and few are lost for good.
    assert call.arrived > 0.95 * 60 * 29.97 / 8
    assert call.shown > 0
