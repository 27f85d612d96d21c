"""The figures of a bench: what they mean, and that two real processes yield them."""

import io
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Start
from processes import LIMIT_S, wait_until

from encoder.capture.video_source import open_source
from loopback.bench import (
    AVERAGED_FIGURES,
    BenchSettings,
    bench_clip,
    bench_table,
    encoder_options,
    is_figure,
    mean_figures,
    output_names,
)
from loopback.call_figures import CALL_FIGURES, latency_ms
from loopback.figures import FIGURES, less_is_better
from loopback.judge.comparison import Comparison
from loopback.judge.observer import EncoderNetworks
from loopback.process_pair import free_port, pinned, run_call
from loopback.report import figure, figure_names, flatten, rounded, table
from loopback.timing_tables import timings_tables
from risorius.cli import main
from shared_model.errors import UserError

MS = 1_000_000


def test_latency_is_from_a_frames_capture_to_its_own_picture() -> None:
    captured = [0, 40 * MS, 80 * MS]
    shown = [(0, 100 * MS), (1, 120 * MS), (2, 180 * MS)]
    assert latency_ms(captured, shown) == {"p50": 100.0, "p99": pytest.approx(100.0)}


def test_a_picture_beyond_the_captured_frames_has_no_latency() -> None:
    assert latency_ms([0], [(0, 5 * MS), (1, 9 * MS)])["p50"] == 5.0
    assert latency_ms([], []) == {"p50": None, "p99": None}


def test_clips_of_one_name_do_not_overwrite_each_other() -> None:
    names = output_names(["a/x.mp4", "b/x.mp4", "c/y.mkv", "d/webcam/frame_%04d.png", "x.avi"])
    assert names == ["x", "x-2", "y", "webcam", "x-3"]


def test_means_leave_out_what_a_clip_does_not_have() -> None:
    clip = {name: 1.0 for name in AVERAGED_FIGURES} | {"frame_bps": 800.0}
    clips = [
        {**clip, "face_psnr_db": 24.0, "face_psnr_p5_db": None},
        {**clip, "face_psnr_db": None, "face_psnr_p5_db": None},
    ]
    mean = mean_figures(clips)
    assert (mean["face_psnr_db"], mean["face_psnr_p5_db"], mean["frame_bps"]) == (24.0, None, 800.0)


def test_every_figure_of_pictures_is_in_the_table_of_figures() -> None:
    of_pictures = figure_names(Comparison) - {"face_frames", "judge", "judge_is_independent"}
    assert of_pictures <= {each.name for each in FIGURES} and all(map(is_figure, of_pictures))
    assert less_is_better("nme_percent") and less_is_better("encoder_ms.fit")
    assert not less_is_better("blink_corr")


def test_a_table_lines_up_and_dashes_what_is_missing() -> None:
    lines = table(("clip", "dB"), [["long name", 24.0], ["b", None]]).splitlines()
    assert lines == ["clip          dB", "---------  -----", "long name  24.00", "b              -"]


def test_a_figure_is_found_by_its_dotted_name() -> None:
    assert figure({"latency_ms": {"p50": 3}}, "latency_ms.p50") == 3
    assert rounded(float("nan")) is None


def test_timings_add_up_to_the_whole_of_each_end() -> None:
    clip = {
        "source": "a.mp4",
        "encoder_ms": {"capture": 2.0, "track": 6.0},
        "decoder_ms": {"render": 4.0},
        "encoder_cpu_ms": {"capture": 0.5, "track": 5.0},
        "decoder_cpu_ms": {"render": 3.0},
        "encoder_frame_ms": {"median": 7.0, "p95": 9.0, "worst": 20.0},
        "decoder_frame_ms": {},
        "overloaded_frames": 3,
        "omitted_frames": 2,
        "worst_lag_ms": 80.0,
        "skipped_frames": 1,
        "encoder_cpu_s": 4.5,
        "encoder_fps": 125.0,
        "decoder_fps": 250.0,
    }
    stages, frames = timings_tables([clip]).split("\n\n")
    assert [line.split("  ")[-1].split() for line in frames.splitlines()[2:]] == [["4.50"], ["-"]]
    assert "one frame  " in frames and "20.00" in frames and "80.00" in frames
    cells = [line.split() for line in stages.splitlines()[2:]]
    assert cells == [
        ["encoder,", "capture", "2.00", "0.50", "25.00", "-"],
        ["encoder,", "track", "6.00", "5.00", "75.00", "-"],
        ["encoder,", "whole", "8.00", "5.50", "100.00", "125.00"],
        ["decoder,", "render", "4.00", "3.00", "100.00", "-"],
        ["decoder,", "whole", "4.00", "3.00", "100.00", "250.00"],
    ]


def test_an_end_that_took_no_time_has_no_shares() -> None:
    idle = {
        **{"encoder_ms": {"capture": 0.0}, "encoder_cpu_ms": {"capture": 0.0}},
        **{"decoder_ms": {}, "decoder_cpu_ms": {}, "encoder_fps": None, "decoder_fps": None},
        **{"encoder_frame_ms": {}, "decoder_frame_ms": {}, "overloaded_frames": 0},
        **{"omitted_frames": 0, "worst_lag_ms": 0.0, "skipped_frames": 0},
        "encoder_cpu_s": 1.0,
    }
    text = timings_tables([{"source": name, **idle} for name in ("a", "b")])
    first, _, second, _ = text.split("\n\n")
    assert first.startswith("a ") and second.startswith("b ")
    assert first.splitlines()[2].split() == ["encoder,", "capture", "0.00", "0.00", "-", "-"]


@pytest.mark.parametrize("source", ["0", "rtsp://192.0.2.1/a"])
def test_a_live_source_cannot_be_compared(source: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="only a recorded video"):
        settings = BenchSettings(encoder_options({}))
        bench_clip(source, settings, tmp_path / "a.mkv", EncoderNetworks(), pytest.fail)


def test_a_call_that_takes_too_long_is_ended(carphone: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="did not end in time") as caught:
        run_call(str(carphone), tmp_path / "out.mkv", [], limit_s=0.5)
    assert caught.value.exit_code == 4


def test_a_call_may_be_held_to_some_cores() -> None:
    core = min(os.sched_getaffinity(0))
    with pinned(str(core)):
        told = subprocess.check_output(
            [sys.executable, "-c", "import os; print(os.sched_getaffinity(0))"], text=True
        )
    assert told.strip() == str({core}) and len(os.sched_getaffinity(0)) >= 1
    for wrong in ("all", "9999"):
        with pytest.raises(UserError, match="cannot run on the cores"), pinned(wrong):
            pytest.fail("it ran")


def test_free_ports_differ_from_call_to_call() -> None:
    assert len({free_port() for _ in range(5)}) > 1


@dataclass(frozen=True, slots=True)
class Benched:
    """A run of `risorius bench` on a clip without a face and on a second of the demo clip."""

    code: int
    printed: str
    said: list[str]
    folder: Path

    @property
    def report(self) -> dict[str, Any]:
        report: dict[str, Any] = json.loads((self.folder / "report.json").read_text())
        return report


@pytest.fixture(scope="module")
def benched(carphone: Path, noise: Path, tmp_path_factory: pytest.TempPathFactory) -> Benched:
    folder, printed, said = tmp_path_factory.mktemp("bench"), io.StringIO(), io.StringIO()
    options = ["--profile", "thesis", "--max-frames", "30", "--timings", "--out", str(folder)]
    with redirect_stdout(printed), redirect_stderr(said):
        code = main(["bench", str(noise), str(carphone), *options])
    return Benched(code, printed.getvalue(), said.getvalue().splitlines(), folder)


def test_bench_reports_every_figure(benched: Benched, carphone: Path) -> None:
    assert "<td>" in (benched.folder / "report.html").read_text()
    report = benched.report
    (clip,) = report["clips"]
    assert (clip["frames"], clip["shown_frames"]) == (30, 30)
    assert (clip["width"], clip["height"], clip["fps"]) == (176, 144, 29.97)
    assert clip["frame_bps"] == 800 and clip["frame_bytes"] == 100
    assert clip["lost_packets"] == 0
    assert 0 < clip["latency_ms"]["p50"] <= clip["latency_ms"]["p99"]
    assert clip["face_psnr_db"] > 20
    assert clip["face_found"] == 1 and 0 < clip["nme_percent"] < 10
    assert {"capture", "track", "send"} <= set(clip["encoder_ms"])
    assert {"animate", "render"} <= set(clip["decoder_ms"])
    for end in ("encoder", "decoder"):
        assert set(clip[f"{end}_cpu_ms"]) == set(clip[f"{end}_ms"])
    times = clip["decoder_frame_ms"]
    assert 0 < times["median"] <= times["p95"] <= times["worst"]
    assert clip["encoder_frame_ms"] == {} and clip["skipped_frames"] == 0
    figures = {name for name, value in flatten(clip) if isinstance(value, int | float)}
    assert all(map(is_figure, figures)) and clip.keys() >= CALL_FIGURES.keys()
    assert not any(map(is_figure, ("profile", "encoder_ms", "frames.p50", "beauty")))
    assert report["mean"]["frame_bps"] == 800
    assert bench_table(report["clips"]) in benched.printed
    assert timings_tables(report["clips"]) in benched.printed
    last = benched.said[-1]
    assert "report.json" in last and "report.html" in last and str(benched.folder) in last
    assert (benched.folder / f"{carphone.stem}.mkv").exists()


@pytest.mark.parametrize("options", [[], ["--sweep", "800"]])
def test_what_is_no_video_is_said_before_anything_runs(
    options: list[str], noise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, out = tmp_path / "text.mp4", tmp_path / "out"
    text.write_text("no video")
    assert main(["bench", str(noise), str(text), *options, "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "text.mp4" in line
    assert not out.exists()


def test_a_clip_that_fails_does_not_cost_the_others(
    benched: Benched, carphone: Path, noise: Path
) -> None:
    assert benched.code == 3
    assert [clip["source"] for clip in benched.report["clips"]] == [carphone.name]
    (failed,) = benched.report["failed"]
    assert failed["source"] == str(noise)
    assert re.search("the encoder stopped with 3: .*no face found", failed["error"])
    assert any(f"warning: {noise} failed: " in line for line in benched.said)


def test_an_interrupted_bench_keeps_the_clips_that_were_finished(
    without_judge: None, carphone: Path, tmp_path: Path, start: Start
) -> None:
    options = ["--profile", "thesis", "--max-frames", "9", "--out", tmp_path]
    bench = start("bench", carphone, carphone, *options)
    second = tmp_path / f"{carphone.stem}-2.encoder.log"
    wait_until(second.exists, bench)
    bench.send_signal(signal.SIGINT)
    printed, complaint = bench.communicate(timeout=LIMIT_S)
    assert bench.returncode == 130
    assert complaint.splitlines()[-1] == "risorius: interrupted"
    (clip,) = json.loads((tmp_path / "report.json").read_text())["clips"]
    assert clip["frames"] == 9 and bench_table([clip]) in printed
    assert (tmp_path / "report.html").exists()


def test_bench_and_file_decode_to_the_same_pictures(
    benched: Benched, carphone: Path, call: Path, tmp_path: Path
) -> None:
    """The link carries the same bytes as the call file."""
    over_file, over_link = tmp_path / "file.mkv", benched.folder / f"{carphone.stem}.mkv"
    assert main(["decode", str(call), "-o", str(over_file), "-q"]) == 0
    with open_source(str(over_file)) as file, open_source(str(over_link)) as link:
        pairs = zip(file, link, strict=True)
        assert all(np.array_equal(ours[1], theirs[1]) for ours, theirs in pairs)
