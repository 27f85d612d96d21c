"""`risorius bench`: options that a sweep refuses, settings that reach the encoder."""

from pathlib import Path

import pytest
from processes import error_line

from loopback.bench import BenchSettings
from risorius.cli import main

Capture = pytest.CaptureFixture[str]


def test_timings_of_a_sweep_are_refused(tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "out"
    assert main(["bench", "a.mp4", "--sweep", "800", "--timings", "--out", str(out)]) == 2
    assert "leave out --sweep" in error_line(capsys)
    assert not out.exists()


@pytest.mark.parametrize(
    "option",
    [
        ("--fps", "10"),
        ("--startup-bitrate", "9000"),
        ("--lids",),
        ("--no-refine",),
        ("--bitrate", "300"),
        ("--model-bytes", "9000"),
        ("--detector", "haar"),
        ("--no-pace",),
    ],
    ids=lambda o: o[0],
)
def test_a_sweep_does_not_pass_over_an_option(option: tuple[str, ...], capsys: Capture) -> None:
    assert main(["bench", "clip.mp4", "--sweep", "800", *option]) == 2
    complaint = error_line(capsys)
    assert "leave out" in complaint and option[0] in complaint


def test_a_bench_refuses_a_start_that_leaves_nothing_for_the_model(
    capsys: Capture,
) -> None:
    assert main(["bench", "clip.mp4", "--startup-bitrate", "700"]) == 2
    assert "leaves nothing for the model" in error_line(capsys)


def test_a_bench_hands_all_its_settings_to_the_encoder() -> None:
    options = BenchSettings({"live": True, "startup_bitrate": 9000.0, "fps": 10.0}).command_line()
    assert "--live" in options
    assert options[options.index("--startup-bitrate") + 1] == "9000.0"
    assert options[options.index("--fps") + 1] == "10.0"
    thesis = {"profile": "thesis", "lids": True, "refine": False}
    options = BenchSettings(thesis).command_line()
    assert {"--lids", "--no-refine"} <= set(options)
