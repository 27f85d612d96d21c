"""What a call file weighs, by the script that also puts it on a wire."""

from dataclasses import replace
from pathlib import Path

from benchmarks.link_rate.__main__ import file_figures
from protocol.summary import summarise


def test_a_minute_has_one_model_and_the_rest_by_time(call: Path) -> None:
    summary = replace(
        summarise(call),
        model_bytes=8000,
        file_bytes=8500,
        duration_s=10.0,
        frame_bps=300.4,
        voice_bps=90.4,
    )
    assert file_figures(summary) == {
        "frame_bps": 300,
        "voice_bps": 90,
        "payload_bps": 391,
        "minute_bytes": 8000 + 6 * 500,
    }
