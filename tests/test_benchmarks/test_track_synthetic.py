"""The synthetic experiment's script and its error measures; its charts."""

import os
import tomllib
from pathlib import Path

import numpy as np
import pytest

from benchmarks.track_synthetic import (
    EAUS,
    POSE,
    TrackedValues,
    calibration_script,
    error_table,
    errors,
    ground_truth_values,
    write_charts,
    write_script,
)
from risorius.animation.animation_script import parse_script
from shared_model import parameters
from shared_model.parameters import EAU_INDEX

TRUTH = {
    "eaus": [eau.name for eau in parameters.EAUS],
    "frames": [
        {
            "pitch_yaw_roll_deg": [step, 2 * step, -step],
            "eau": [0.01 * step] * len(parameters.EAUS),
            "focal_px": 800.0,
        }
        for step in range(20)
    ],
}


def test_the_sequence_starts_at_rest_and_goes_to_its_ends() -> None:
    script = parse_script(tomllib.loads(calibration_script(24)), Path())
    assert script.frames == 600
    moments = [script.at(t) for t in np.arange(0, 24, 0.04)]
    assert moments[0].eau == pytest.approx(np.zeros(len(moments[0].eau)))
    for name, (most, _) in POSE.items():
        values = [moment.pose[name] for moment in moments]
        assert values[0] == 0
        assert max(values) == pytest.approx(most, rel=0.03)
        assert min(values) == pytest.approx(-most, rel=0.03)
    for name, (most, _) in EAUS.items():
        values = [moment.eau[EAU_INDEX[name]] for moment in moments]
        assert max(values) == pytest.approx(most, rel=0.03)
        assert min(values) == pytest.approx(0 if name == "jaw_drop" else -most, rel=0.03)


def test_the_sequence_turns_as_far_as_it_is_told() -> None:
    script = parse_script(tomllib.loads(calibration_script(24, yaw_deg=20)), Path())
    yaw = [script.at(t).pose["yaw"] for t in np.arange(0, 24, 0.04)]
    assert max(yaw) == pytest.approx(20, rel=0.03)


def test_only_another_script_makes_sequences_old(tmp_path: Path) -> None:
    script = write_script(tmp_path, 25, 45)
    os.utime(script, ns=(1, 1))
    assert write_script(tmp_path, 25, 45).stat().st_mtime_ns == 1
    assert write_script(tmp_path, 25, 40).stat().st_mtime_ns > 1


def test_the_truth_has_no_error() -> None:
    figures = errors(TrackedValues(ground_truth_values(TRUTH), 800.0), TRUTH)
    assert figures["rmse"] == pytest.approx([0] * 7)
    assert figures["lost"] == 0 and figures["focal_percent"] == 0


def test_an_offset_counts_but_not_about_the_mean() -> None:
    figures = errors(TrackedValues(ground_truth_values(TRUTH) + 0.5, 840.0), TRUTH)
    assert figures["rmse"] == pytest.approx([0.5] * 7)
    assert figures["about_mean"] == pytest.approx([0] * 7)
    assert figures["focal_percent"] == pytest.approx(5)


def test_angles_are_compared_round_the_circle() -> None:
    turned = ground_truth_values(TRUTH)
    turned[:, 2] += 359
    assert errors(TrackedValues(turned, 800.0), TRUTH)["rmse"][2] == pytest.approx(1)


def test_frames_without_a_face_are_counted_and_left_out() -> None:
    values = ground_truth_values(TRUTH)
    values[5:10] = np.nan
    figures = errors(TrackedValues(values, 800.0), TRUTH)
    assert figures["lost"] == 0.25 and figures["rmse"] == pytest.approx([0] * 7)


def test_the_table_has_the_thesis_and_every_caller() -> None:
    figures = errors(TrackedValues(ground_truth_values(TRUTH), 800.0), TRUTH)
    table = error_table({"anna": {"all parts": figures}, "otto": {"all parts": figures}})
    assert "| thesis | | 3.40 | 4.57 | 2.55 | 0.095" in table
    assert "| all parts | anna |" in table and "| all parts | otto |" in table


def test_the_charts_are_a_page(tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="needs plotly: pip install '.[report]'")
    names = list(parameters.THESIS_EAUS)
    frames = [
        {"time_s": i / 25, "pitch_yaw_roll_deg": [i, 0, 0], "eau": [0.0] * len(names)}
        for i in range(9)
    ]
    truth = {"eaus": names, "frames": frames}
    values = ground_truth_values(truth)
    write_charts(tmp_path / "a", truth, {"all parts": TrackedValues(values, 0)})
    page = (tmp_path / "a.html").read_text()
    assert "all parts" in page and "plotly" in page and page.count("degrees") >= 3
