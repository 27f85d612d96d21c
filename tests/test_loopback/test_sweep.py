"""Rate-distortion sweeps: what is measured, that nothing is measured twice, what is drawn."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import cv2
import pytest
from conftest import without_layers

from loopback.sweep import SweepSettings, mean_curve, sweep, sweep_table
from risorius.cli import main

FRAMES = 24


def no_progress(label: str) -> AbstractContextManager[Callable[[int, int | None], None]]:
    return nullcontext(lambda done, total: None)


def test_means_are_over_the_rates_that_all_clips_share() -> None:
    def point(rate: float, psnr: float | None) -> dict[str, float | None]:
        return {
            "bitrate": rate,
            "frame_bps": rate - 10,
            "face_psnr_db": psnr,
            "face_psnr_p5_db": psnr,
            "full_psnr_db": 20.0,
        }

    curves = [
        {"points": [point(200, 30.0), point(800, 34.0)]},
        {"points": [point(800, 36.0), point(2000, 38.0)]},
        {"points": [point(800, None)]},
    ]
    (mean,) = mean_curve(curves)
    assert mean["bitrate"] == 800 and mean["frame_bps"] == 790
    assert mean["face_psnr_db"] == 35 and mean["full_psnr_db"] == 20
    assert mean_curve([]) == []


def test_a_sweep_measures_draws_and_goes_on_where_it_was(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "sweep"
    options = ["--max-frames", str(FRAMES), "--out", str(out)]
    with without_layers():
        assert main(["bench", "--sweep", "300,900", str(carphone), *options]) == 0
    report = json.loads((out / "report.json").read_text())
    printed = capsys.readouterr()
    assert sweep_table(report) in printed.out
    assert f"in {out}" in printed.err.splitlines()[-1]
    low, high = report["curves"][carphone.stem]["points"]
    assert low["frames"] == high["frames"] == FRAMES
    assert low["frame_bps"] < high["frame_bps"] <= 900 and low["frame_bps"] <= 300
    assert 28 < low["face_psnr_db"] < high["face_psnr_db"]
    assert sum(low["groups"].values()) * 8 == pytest.approx(
        low["frame_bps"] * FRAMES * 1001 / 30000, abs=2
    )
    assert cv2.imread(str(out / "rate_distortion.png")) is not None
    assert (out / "rate_distortion.svg").read_text().startswith("<svg")
    assert not list(out.glob("*.mkv"))

    said: list[str] = []
    again, _ = sweep(
        [str(carphone)], SweepSettings((300, 900), FRAMES), out, said.append, no_progress
    )
    assert said == [f"sweep: {carphone.stem}: measured already"]
    assert again["curves"] == report["curves"]


def test_rates_that_are_none_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--sweep", "200,fast", "a.mp4"]) == 2
    assert "--sweep" in capsys.readouterr().err


def test_a_clip_that_fails_does_not_cost_the_others(
    carphone: Path, noise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["bench", "--sweep", "400", str(noise), str(carphone), "--max-frames", "9"]
    with without_layers():
        assert main([*line, "--out", str(tmp_path)]) == 3
    printed = capsys.readouterr()
    assert f"warning: {noise} failed: " in printed.err and "no face found" in printed.err
    assert carphone.stem in printed.out
    assert [*json.loads((tmp_path / "report.json").read_text())["curves"]] == [carphone.stem]
