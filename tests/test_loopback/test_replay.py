"""Suites are read strictly, thresholds hold both ways, and a CI can read the outcome."""

import hashlib
import signal
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from conftest import ROOT, Start
from processes import LIMIT_S, error_line, wait_until

from loopback.bench import BenchSettings
from loopback.replay import (
    Check,
    Clip,
    ClipResult,
    Suite,
    check,
    junit_xml,
    read_suite,
    replay_table,
)
from risorius.cli import main
from shared_model.errors import UserError

DEMO_SUITE = ROOT / "tests" / "suites" / "demo.toml"
FIGURES = {"frames": 60, "face_psnr_db": 24.5, "latency_ms": {"p50": 80.0, "p99": None}}


def write_suite(folder: Path, text: str) -> Path:
    path = folder / "suite.toml"
    path.write_text(text)
    return path


def clip(least: dict[str, float], most: dict[str, float]) -> Clip:
    return Clip("a", "a.mp4", "00", BenchSettings(), least, most)


def test_a_suite_says_what_to_replay_and_what_to_hold(tmp_path: Path) -> None:
    suite = read_suite(
        write_suite(
            tmp_path,
            """
            name = "night"
            settings = { max_frames = 9, pace = false }
            [[clip]]
            path = "sub/a.mp4"
            sha256 = "AB"
            settings.max_frames = 5
            min.face_psnr_db = 24
            max.latency_ms.p50 = 120
            [[clip]]
            name = "images"
            path = "/clips/frame_%04d.png"
            """,
        )
    )
    assert suite.name == "night"
    first, second = suite.clips
    assert (first.name, first.path) == ("a.mp4", str(tmp_path / "sub" / "a.mp4"))
    assert first.settings == BenchSettings(max_frames=5, pace=False)
    assert first.least == {"face_psnr_db": 24} and first.most == {"latency_ms.p50": 120}
    assert (second.name, second.path) == ("images", "/clips/frame_%04d.png")
    assert second.settings.max_frames == 9


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no \\[\\[clip\\]\\]"),
        ("clip = 3", "no \\[\\[clip\\]\\]"),
        ("[[clip]]\n", "has no path"),
        ("[[clip]]\npath = 3", "has no path"),
        ("[[clip]]\npath = 'a.mp4'", "no sha256"),
        ("[[clip]]\nname = '90 %'\npath = 'a.mp4'", "no sha256"),
        ("[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\nmost = {}", "unknown keys: most"),
        ("speed = 2\n[[clip]]\npath = 'a.mp4'\nsha256 = 'a'", "unknown keys: speed"),
        ("[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\nmin = 3", "min is not a table"),
        ("[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\nmin.fps = 'x'", "min of fps is not a number"),
        ("[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\nsettings.x = 1", "unknown settings x"),
        ("[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\nmax.frame_bpz = 1", "max: .* figure frame_bpz"),
        ("[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\nmin.latency_ms.p5 = 1", "figure latency_ms.p5"),
        ("settings.profile = 'thesys'\n[[clip]]\npath = 'a'\nsha256 = 'a'", "clip a: .*thesys"),
        (
            "settings.profile = 3\n[[clip]]\npath = 'a'\nsha256 = 'a'",
            "profile: 3 is none of default, thesis",
        ),
        ("settings.bitrate = 'fast'\n[[clip]]\npath = 'a'\nsha256 = 'a'", "fast is not a number"),
        (
            "settings.bitrate = true\n[[clip]]\npath = 'a'\nsha256 = 'a'",
            "true nor false for bitrate",
        ),
        (
            "settings.live = 'no'\n[[clip]]\npath = 'a'\nsha256 = 'a'",
            "true or false for live",
        ),
        ("settings.lids = true\n[[clip]]\npath = 'a'\nsha256 = 'a'", "lids = true is about"),
        ("[[clip]]\npath = 'package:none_such/a.mp4'\nsha256 = 'a'", "not installed"),
        ("[[clip", "is not a suite in TOML"),
    ],
)
def test_a_suite_with_a_mistake_is_refused(text: str, reason: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=reason):
        read_suite(write_suite(tmp_path, text))


def test_a_misspelt_figure_is_one_line_before_anything_runs(
    noise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f"[[clip]]\npath = '{noise}'\nsha256 = 'a'\nmax.frame_bpz = 1"
    out = tmp_path / "out"
    assert main(["replay", str(write_suite(tmp_path, text)), "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "frame_bpz" in line and not out.exists()


def test_a_missing_suite_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        read_suite(tmp_path / "none.toml")


def test_thresholds_hold_at_their_own_value() -> None:
    checks = check(clip({"frames": 60}, {"latency_ms.p50": 80}), FIGURES)
    assert [item.passed for item in checks] == [True, True]


def test_a_missed_threshold_says_what_was_measured() -> None:
    checks = check(clip({"face_psnr_db": 25}, {"latency_ms.p50": 79.9}), FIGURES)
    assert checks == (
        Check("face_psnr_db", ">= 25", 24.5, False),
        Check("latency_ms.p50", "<= 79.9", 80.0, False),
    )


def test_a_figure_that_is_not_there_is_a_miss() -> None:
    checks = check(clip({"beauty": 1}, {"latency_ms.p99": 500}), FIGURES)
    assert [(item.value, item.passed) for item in checks] == [(None, False), (None, False)]


def test_junit_counts_each_threshold_and_each_broken_clip() -> None:
    results = [
        ClipResult("a", {}, (Check("frames", ">= 60", 60, True),), None),
        ClipResult("b", {}, (Check("frames", ">= 60", 59, False),), None),
        ClipResult("c", {}, (), "no such file"),
        ClipResult("d", {}, (), None),
    ]
    root = ElementTree.fromstring(junit_xml(Suite("night", ()), results))
    assert (root.tag, root.get("name")) == ("testsuite", "night")
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == ("4", "1", "1")
    failure = root.find("testcase[@classname='night.b']/failure")
    assert failure is not None and failure.get("message") == "measured 59"
    table = replay_table(results)
    assert "MISSED" in table and "no such file" in table


def test_all_clips_are_looked_at_before_the_first_is_encoded(
    carphone: Path, noise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = hashlib.sha256(carphone.read_bytes()).hexdigest()
    clips = [(carphone, good), (noise, "0" * 64), (tmp_path / "none.mkv", "0" * 64)]
    text = "".join(f"[[clip]]\npath = '{path}'\nsha256 = '{sum_}'\n" for path, sum_ in clips)
    out = tmp_path / "out"
    assert main(["replay", str(write_suite(tmp_path, text)), "--out", str(out)]) == 2
    said = error_line(capsys)
    assert "noise.mkv is another file than the suite means" in said
    assert "none.mkv: no such file" in said and not out.exists()


def test_mistakes_of_clips_are_named_with_those_of_the_other_files(
    noise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f"""
        [[clip]]
        path = "none.mkv"
        sha256 = "00"
        [[clip]]
        path = "{noise}"
        sha256 = "00"
        [[clip]]
        path = "unsigned.mkv"
        [[clip]]
        path = "set.mkv"
        sha256 = "00"
        settings = {{ wrong = 1 }}
        """
    assert main(["replay", str(write_suite(tmp_path, text)), "--out", str(tmp_path / "out")]) == 2
    said = error_line(capsys)
    for part in (
        "none.mkv: no such file",
        "is another file",
        "unsigned.mkv has no sha256",
        "wrong",
    ):
        assert part in said


def test_neither_a_clip_that_fails_nor_a_missed_threshold_stops_a_replay(
    carphone: Path, noise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (noise, carphone)]
    failing = f"[[clip]]\npath = '{noise}'\nsha256 = '{sums[0]}'\nsettings.profile = 'thesis'\n"
    missing = f'''
        [[clip]]
        path = "{carphone}"
        sha256 = "{sums[1]}"
        settings = {{ profile = "thesis", max_frames = 9 }}
        min = {{ frames = 9, face_psnr_db = 99 }}
        max = {{ lost_frames = 0 }}
        '''
    junit = tmp_path / "new" / "junit.xml"
    suite = write_suite(tmp_path, failing + missing)
    assert main(["replay", str(suite), "--out", str(tmp_path), "--junit", str(junit)]) == 1
    printed = capsys.readouterr().out
    assert printed.count("no face found") == 1
    (missed,) = (line for line in printed.splitlines() if "MISSED" in line)
    assert "face_psnr_db" in missed
    root = ElementTree.parse(junit).getroot()
    assert (root.get("tests"), root.get("errors"), root.get("failures")) == ("4", "1", "1")


def test_the_demo_suite_passes_in_two_processes_over_zenoh(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["replay", str(DEMO_SUITE), "--out", str(tmp_path)])
    printed = capsys.readouterr()
    assert code == 0, printed.out
    assert f"in {tmp_path}" in printed.err.splitlines()[-1]
    assert (tmp_path / "carphone.mkv").exists()
    assert (tmp_path / "report.json").exists()


def test_an_interrupted_replay_keeps_the_clips_that_were_finished(
    carphone: Path, tmp_path: Path, start: Start
) -> None:
    settings = "settings = { profile = 'thesis', max_frames = 9 }\n"
    sum_ = hashlib.sha256(carphone.read_bytes()).hexdigest()
    clip = f"[[clip]]\npath = '{carphone}'\nsha256 = '{sum_}'\n"
    suite, junit = write_suite(tmp_path, settings + 2 * clip), tmp_path / "junit.xml"
    replay = start("replay", suite, "--out", tmp_path / "out", "--junit", junit)
    wait_until((tmp_path / "out" / f"{carphone.stem}-2.encoder.log").exists, replay)
    replay.send_signal(signal.SIGTERM)
    printed, _ = replay.communicate(timeout=LIMIT_S)
    assert replay.returncode == 130
    assert carphone.name in printed
    assert (tmp_path / "out" / "report.json").exists() and not junit.exists()
