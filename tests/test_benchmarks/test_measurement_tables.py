"""Tables of docs/measurements.md: each profile's figures go between its own marks."""

from typing import Any

import pytest

from benchmarks.measurement_tables import MEASUREMENTS, markdown, marks, replaced


def report(profile: str, psnr: float | None) -> dict[str, Any]:
    clip = {
        "source": "a.mp4",
        "frames": 120,
        "width": 176,
        "height": 144,
        "fps": 29.97,
        "model_bytes": 11021,
        "frame_bps": 800.0,
        "face_psnr_db": psnr,
        "face_psnr_p5_db": psnr,
        "nme_percent": 2.345,
        "mouth_corr": 0.912,
        "blink_corr": None,
        "latency_ms": {"p50": 116.4, "p99": None},
        "encoder_ms": {"track": 10.0, "fit": 2.55},
        "decoder_ms": {"render": 3.0},
    }
    mean: dict[str, float | None] = {
        "model_bytes": 11021.0,
        "frame_bps": 800.0,
        "face_psnr_db": 24.0,
    }
    mean |= {"face_psnr_p5_db": 20.0, "nme_percent": 2.3, "mouth_corr": 0.9, "blink_corr": None}
    return {"settings": {"profile": profile}, "clips": [clip], "mean": mean}


def test_the_table_says_each_figure_and_the_means() -> None:
    lines = markdown(report("thesis", 24.07)).splitlines()
    assert "800 bit/s at 24.0 dB" in lines[0] and "--profile thesis a.mp4" in lines[0]
    assert lines[4].startswith("| a | 176x144, 30/s | 120 | 11021 | 800 | 24.1 | 24.1 | 2.3 | 0.91")
    assert lines[4].endswith("| 0.91 / - | 116 / - | 12.6 | 3.0 |")
    assert lines[5].startswith("| **mean** |  |  | 11021 | 800 | 24.0 | 20.0 | 2.3 | 0.90 / - |")
    assert len({line.count("|") for line in lines[2:]}) == 1


def test_a_call_that_looks_ahead_has_no_latency_in_its_table() -> None:
    table = markdown(report("default", None))
    assert "latency" not in table and "ms/frame" in table
    assert "ms" not in markdown(report("thesis", 24.0), times=False).splitlines()[2]


def test_a_profile_leaves_the_other_ones_table_alone() -> None:
    text = "".join(f"x\n{''.join(marks(profile))}" for profile in ("thesis", "default"))
    once = replaced(text, report("thesis", 24.0))
    both = replaced(once, report("default", 35.0))
    assert "24.0" in once.split(marks("thesis")[1])[0]
    assert both.startswith(once.split(marks("default")[0])[0])
    assert replaced(both, report("default", 35.0)) == both


def test_the_measurements_have_the_marks_of_every_profile() -> None:
    text = MEASUREMENTS.read_text(encoding="utf-8")
    for profile in ("thesis", "default", "live"):
        assert all(text.count(mark) == 1 for mark in marks(profile))
    with pytest.raises(ValueError):
        replaced("no marks", report("thesis", 1.0))
