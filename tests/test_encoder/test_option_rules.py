"""Options that go together, and the profile they ask for."""

import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from conftest import without_layers
from processes import error_line

from encoder.appearance.photometric import NORMALISATIONS
from encoder.option_rules import as_typed, checked_options
from encoder.thesis.klt import KLT_POINTS
from encoder.thesis.measurement_model import PROJECTIONS
from encoder.thesis.tracking_options import DETECTORS, FITTERS, TRACKERS
from protocol.summary import summarise
from risorius.cli import build_parser, main

Capture = pytest.CaptureFixture[str]


def test_a_paced_start_needs_its_profile_and_room_beside_the_frames(
    capsys: Capture,
) -> None:
    line = ["encode", "clip.mp4", "-o", "call.rzo", "--startup-bitrate"]
    assert main([*line, "8000", "--profile", "thesis"]) == 2
    assert "--profile default" in error_line(capsys)
    assert main([*line, "800", "--profile", "default"]) == 2
    assert "leaves nothing for the model" in error_line(capsys)


@pytest.mark.parametrize("option", ["--live", "--fps 10"])
@pytest.mark.parametrize("command", ["encode clip.mp4 -o call.rzo", "bench clip.mp4"])
def test_what_is_of_the_default_profile_is_refused_without_it(
    command: str, option: str, capsys: Capture
) -> None:
    assert main([*command.split(), *option.split(), "--profile", "thesis"]) == 2
    assert "--profile default" in error_line(capsys)


@pytest.mark.parametrize(
    "option",
    ["--detector haar", "--aam m.npz", "--tracker single", "--abs matrix", "--lids", "--no-refine"],
)
def test_what_is_of_the_thesis_profile_is_refused_in_the_other(
    option: str, capsys: Capture
) -> None:
    line = ["encode", "clip.mp4", "-o", "call.rzo", "--profile", "default"]
    assert main([*line, *option.split()]) == 2
    assert "--profile thesis" in error_line(capsys)


@pytest.mark.parametrize("of_default", ["--bitrate 400", "--live", "--fps 10"])
@pytest.mark.parametrize("profile", ["", "--profile default", "--profile thesis"])
def test_options_of_both_profiles_are_refused_without_circular_advice(
    of_default: str, profile: str, capsys: Capture
) -> None:
    line = f"encode clip.mp4 -o call.rzo --lids {of_default} {profile}"
    assert main(line.split()) == 2
    said = error_line(capsys)
    assert "do not go together" in said and "--lids" in said and of_default.split()[0] in said


@pytest.mark.parametrize(
    "line",
    [
        "encode clip.mp4 -o call.rzo --wait 5",
        "encode clip.mp4 -o call.rzo --lossless",
        "encode clip.mp4 -o call.rzo --call anna",
        "decode call.rzo --timeout 5",
        "decode call.rzo --call anna",
    ],
)
def test_what_is_about_a_link_is_refused_with_a_file(line: str, capsys: Capture) -> None:
    assert main(line.split()) == 2
    said = error_line(capsys)
    assert "does not go with" in said and f"leave out --{line.split(' --')[1].split()[0]}" in said


@pytest.mark.parametrize(
    ("option", "profile"),
    [
        ("-q", "default"),
        ("--tracker single", "thesis"),
        ("--lids", "thesis"),
        ("--texture-modes 1", "default"),
        ("--projection lowe --free-focal", "thesis"),
        ("--fps 15", "default"),
    ],
)
def test_the_profile_follows_from_the_options(
    option: str, profile: str, carphone: Path, networks: Path, tmp_path: Path
) -> None:
    path = tmp_path / "call.rzo"
    line = ["encode", str(carphone), "-o", str(path), "--max-frames", "2"]
    with without_layers():
        assert main([*line, *option.split()]) == 0
    assert summarise(path).profile == profile


@pytest.mark.parametrize(
    ("option", "known"),
    [
        ("--detector", DETECTORS),
        ("--tracker", TRACKERS),
        ("--normalise", NORMALISATIONS),
        ("--abs", FITTERS),
        ("--klt-points", KLT_POINTS),
        ("--projection", PROJECTIONS),
    ],
)
def test_the_choices_of_an_option_are_those_that_the_encoder_has(
    option: str, known: Iterable[str], capsys: Capture
) -> None:
    assert main(["encode", "clip.mp4", "-o", "call.rzo", option, "?"]) == 2
    named = error_line(capsys).partition("choose from ")[2].partition(")")[0]
    assert re.findall(r"[\w-]+", named) == list(known)


@pytest.mark.parametrize(
    ("options", "idle"),
    [
        ("--tracker single --without klt,ekf", "--without ekf,klt"),
        ("--tracker single --abs matrix", "--abs matrix"),
        ("--tracker single --normalise retinex", "--normalise retinex"),
        ("--tracker single --no-refine", "--no-refine"),
        ("--without klt --klt-points visible", "--klt-points visible"),
        ("--without abs,klt --normalise retinex", "--normalise retinex"),
        ("--detector haar --lids", "--lids"),
        ("--aam m.npz --detector haar", "--detector haar"),
        ("--texture-modes 4 --no-refine", "--no-refine"),
        ("--without ekf --free-focal", "--free-focal"),
        ("--detector network --nose-cascade n.xml", "--nose-cascade n.xml"),
    ],
)
def test_options_without_effect_in_a_combination_are_refused(
    options: str, idle: str, capsys: Capture
) -> None:
    line = ["encode", "clip.mp4", "-o", "call.rzo", *options.split()]
    assert main(line) == 2
    assert f"{idle} has no effect with --{options.split('--')[1].split()[0]}" in error_line(capsys)


@pytest.mark.parametrize(
    "options",
    [
        "--tracker single --detector haar",
        "--without klt,ekf",
        "--klt-points visible",
        "--aam m.npz --no-refine",
        "--aam m.npz --nose-cascade n.xml",
    ],
)
def test_options_that_go_together_are_taken(options: str) -> None:
    arguments = build_parser().parse_args(["encode", "a.mp4", "-o", "a.rzo", *options.split()])
    assert checked_options(vars(arguments), as_typed)["profile"] == "thesis"


def test_a_preset_stands_for_options_that_may_still_be_given_otherwise() -> None:
    line = ["encode", "a.mp4", "-o", "a.rzo", "--preset", "thesis-literal"]
    arguments = build_parser().parse_args(line)
    assert checked_options(vars(arguments), as_typed)["profile"] == "thesis"
    expanded = checked_options(vars(arguments), as_typed)
    named = [expanded[name] for name in ("profile", "aam", "abs", "normalise", "tracker")]
    assert named == ["thesis", "builtin", "mirrored-matrix", "retinex", "full"]
    arguments = build_parser().parse_args([*line, "--abs", "mirrored", "--aam", "m.npz"])
    expanded = checked_options(vars(arguments), as_typed)
    assert [expanded["abs"], expanded["aam"]] == ["mirrored", "m.npz"]


@pytest.mark.parametrize(
    "command", [["encode", "-o", "a.rzo"], ["track"], ["bench", "--labels", "l"]]
)
def test_the_feedback_of_a_model_needs_a_model(capsys: Capture, command: list[str]) -> None:
    assert main([*command, "a.mp4", "--aam-feedback"]) == 2
    assert "add --aam MODEL" in error_line(capsys)


def test_a_search_in_every_frame_needs_a_model(capsys: Capture) -> None:
    line = ["encode", "a.mp4", "-o", "a.rzo", "--aam-every-frame"]
    assert main(line) == 2
    assert "add --aam MODEL" in error_line(capsys)


def test_a_model_measures_by_its_landmarks_or_by_its_parameters(capsys: Capture) -> None:
    line = ["encode", "a.mp4", "-o", "a.rzo", "--aam", "builtin", "--aam-feedback"]
    assert main([*line, "--aam-every-frame"]) == 2
    assert "--aam-every-frame has no effect" in error_line(capsys)


def test_a_preset_of_the_thesis_is_refused_with_the_default_profile(capsys: Capture) -> None:
    line = ["encode", "a.mp4", "-o", "a.rzo", "--preset", "thesis-literal"]
    assert main([*line, "--profile", "default"]) == 2
    assert "--profile thesis" in error_line(capsys)
