"""`risorius bench`: options that a sweep refuses, settings that reach the encoder."""

from pathlib import Path

import pytest
from processes import error_line

from encoder.option_rules import Options
from loopback.bench import ENCODER_OPTIONS, BenchSettings, encoder_options
from risorius.cli import build_parser, main

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
    given = {"live": True, "startup_bitrate": 9000.0, "fps": 10.0}
    options = BenchSettings(encoder_options(given)).command_line()
    assert "--live" in options
    assert options[options.index("--startup-bitrate") + 1] == "9000.0"
    assert options[options.index("--fps") + 1] == "10.0"
    thesis = {"profile": "thesis", "lids": True, "refine": False}
    options = BenchSettings(encoder_options(thesis)).command_line()
    assert {"--lids", "--no-refine"} <= set(options)


# One for each of `ENCODER_OPTIONS`, none the default.
OTHER_VALUES: Options = {
    "preset": "thesis-literal",
    "profile": "thesis",
    "max_frames": 5,
    "pace": False,
    "model_bytes": 9000,
    "lids": True,
    "texture_modes": 3,
    "detector": "haar",
    "aam": "builtin",
    "nose_cascade": "nose.xml",
    "aam_every_frame": True,
    "aam_feedback": True,
    "tracker": "single",
    "normalise": "retinex",
    "abs": "matrix",
    "klt_points": "visible",
    "projection": "lowe",
    "free_focal": True,
    "refine": False,
    "bitrate": 1200.0,
    "live": True,
    "low_delay": True,
    "delay": 0.5,
    "fps": 12.5,
    "startup_bitrate": 9000.0,
}


@pytest.mark.parametrize("name", ENCODER_OPTIONS)
def test_an_encoder_takes_every_setting_of_a_bench(name: str) -> None:
    value = OTHER_VALUES[name]
    assert value != ENCODER_OPTIONS[name]
    settings = BenchSettings(encoder_options({name: value}))
    line = ["encode", "a.mp4", "--connect", "tcp/127.0.0.1:7447", *settings.command_line()]
    assert vars(build_parser().parse_args(line))[name] == value


def test_settings_that_name_a_default_are_those_that_do_not() -> None:
    assert encoder_options({"bitrate": 800, "busy": 3}) == encoder_options({})
