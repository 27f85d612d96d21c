"""Suites are read strictly, thresholds hold both ways, and a CI can read the outcome."""

import hashlib
import json
import signal
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Start
from processes import LIMIT_S, error_line, wait_until

from loopback.bench import ENCODER_OPTIONS, BenchSettings, encoder_options
from loopback.replay.checks import (
    PICTURES,
    Check,
    ExpectedEvent,
    baseline_changes,
    baseline_of,
    check_baseline,
    read_baseline,
    write_baseline,
)
from loopback.replay.outcome import junit_xml, replay_table
from loopback.replay.runs import ClipResult, check
from loopback.replay.suite import Clip, Suite, read_suite
from risorius.cli import main
from shared_model.errors import UserError

pytestmark = pytest.mark.usefixtures("without_judge")
DEMO_SUITE = ROOT / "tests" / "suites" / "demo.toml"
FIGURES = {"frames": 60, "face_psnr_db": 24.5, "latency_ms": {"p50": 80.0, "p99": None}}


def write_suite(folder: Path, text: str) -> Path:
    path = folder / "suite.toml"
    path.write_text(text)
    return path


def clip(least: dict[str, float], most: dict[str, float]) -> Clip:
    return Clip("a", "a.mp4", "00", BenchSettings(encoder_options({})), least, most)


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
    assert first.settings.encoder == {**ENCODER_OPTIONS, "max_frames": 5, "pace": False}
    assert first.least == {"face_psnr_db": 24} and first.most == {"latency_ms.p50": 120}
    assert (second.name, second.path) == ("images", "/clips/frame_%04d.png")
    assert second.settings.encoder["max_frames"] == 9


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ("preset = 'thesis-literal'", {"profile": "thesis", "aam": "builtin"}),
        ("lids = true", {"profile": "thesis", "lids": True}),
        ("detector = 'haar'", {"profile": "thesis", "detector": "haar"}),
        ("live = true", {"profile": "default", "live": True}),
        ("max_frames = 9", {"profile": "default", "max_frames": 9}),
    ],
)
def test_settings_of_a_suite_need_no_profile_beside_them(
    settings: str, expected: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Whatever is installed: a suite measures the same everywhere.
    monkeypatch.setattr("encoder.option_rules.available_profile", lambda: "thesis")
    text = f"settings = {{ {settings} }}\n[[clip]]\npath = 'a.mp4'\nsha256 = 'a'"
    (clip,) = read_suite(write_suite(tmp_path, text)).clips
    assert clip.settings.encoder.items() >= expected.items()


def test_settings_of_the_bench_itself_are_read(tmp_path: Path) -> None:
    text = "settings = { busy = 2, cores = '0,1' }\n[[clip]]\npath = 'a.mp4'\nsha256 = 'a'"
    (clip,) = read_suite(write_suite(tmp_path, text)).clips
    assert (clip.settings.busy, clip.settings.cores) == (2, "0,1")


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
        (
            "settings = { lids = true, profile = 'default' }\n[[clip]]\npath = 'a'\nsha256 = 'a'",
            "lids = true is about",
        ),
        (
            "settings = { lids = true, live = true }\n[[clip]]\npath = 'a'\nsha256 = 'a'",
            "do not go together",
        ),
        ("settings.busy = 'x'\n[[clip]]\npath = 'a'\nsha256 = 'a'", "busy: x is no whole number"),
        ("settings.busy = 17\n[[clip]]\npath = 'a'\nsha256 = 'a'", "busy: 17 is no whole number"),
        ("settings.busy = 1.5\n[[clip]]\npath = 'a'\nsha256 = 'a'", "busy: 1.5 is no whole"),
        ("settings.cores = 1\n[[clip]]\npath = 'a'\nsha256 = 'a'", "cores: 1 is no text"),
        ("settings.cores = '0,'\n[[clip]]\npath = 'a'\nsha256 = 'a'", "cores: 0, is no text"),
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
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    no_call = tmp_path / "no_call.rzo"
    no_call.write_text("no call")
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (no_call, carphone)]
    failing = f"[[clip]]\npath = '{no_call}'\nsha256 = '{sums[0]}'\n"
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
    assert printed.count("no call file") == 1
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
    call: Path, carphone: Path, tmp_path: Path, start: Start
) -> None:
    clips = [
        f"[[clip]]\npath = '{path}'\nsha256 = '{hashlib.sha256(path.read_bytes()).hexdigest()}'\n"
        for path in (call, carphone)
    ]
    settings = "settings.profile = 'thesis'\n"
    suite, junit = write_suite(tmp_path, settings + "".join(clips)), tmp_path / "junit.xml"
    replay = start("replay", suite, "--out", tmp_path / "out", "--junit", junit)
    wait_until((tmp_path / "out" / f"{carphone.stem}.encoder.log").exists, replay)
    replay.send_signal(signal.SIGTERM)
    printed, _ = replay.communicate(timeout=LIMIT_S)
    assert replay.returncode == 130
    assert call.name in printed
    assert (tmp_path / "out" / "report.json").exists() and not junit.exists()


HELD = {"face_psnr_db": 0.3, "frame_bps": 20.0, "latency_ms.p50": 5.0}


@pytest.mark.parametrize(
    "now, missed",
    [
        ({}, set()),
        ({"face_psnr_db": 23.9}, {"face_psnr_db"}),
        ({"face_psnr_db": 24.3, "frame_bps": 815}, set()),
        ({"frame_bps": 821}, {"frame_bps"}),
        ({"frame_bps": 200, "face_psnr_db": 40}, set()),
        ({"latency_ms": {"p50": 86}}, {"latency_ms.p50"}),
        ({"face_psnr_db": None}, {"face_psnr_db"}),
    ],
)
def test_a_figure_may_be_worse_by_its_tolerance(now: dict[str, Any], missed: set[str]) -> None:
    before = {"face_psnr_db": 24.5, "frame_bps": 800, "latency_ms": {"p50": 80.0}}
    kept = baseline_of(before, HELD)
    assert kept == {"face_psnr_db": 24.5, "frame_bps": 800, "latency_ms.p50": 80.0}
    checks = list(check_baseline(before | now, kept, HELD))
    assert len(checks) == 3
    assert {each.figure for each in checks if not each.passed} == missed


def test_changed_pictures_are_noticed() -> None:
    kept = baseline_of({PICTURES: "ab" * 32}, {})
    (same,) = check_baseline({PICTURES: "ab" * 32}, kept, {})
    (other,) = check_baseline({PICTURES: "cd" * 32}, kept, {})
    assert same.passed and not other.passed and other.value == "cdcdcdcdcdcd"
    assert list(check_baseline({PICTURES: "ab"}, {}, {})) == []


def test_a_baseline_is_written_a_figure_a_line_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    clips = {"b": {"frame_bps": 790.0}, "a": {"face_psnr_db": 34.5, "frame_bps": 800.0}}
    write_baseline(path, clips)
    assert read_baseline(path) == clips
    assert path.read_text().index('"a"') < path.read_text().index('"b"')
    assert '      "frame_bps": 800.0\n' in path.read_text()
    changed = baseline_changes(clips, {"a": {"face_psnr_db": 34.9, "frame_bps": 800.0}})
    assert "34.90" in changed and "gone" in changed and "800" not in changed
    assert baseline_changes(clips, clips) == ""


@pytest.mark.parametrize("text", ["", "[]", '{"clips": []}', '{"clips": {"a": 3}}', "{"])
def test_what_is_no_baseline_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    path.write_text(text)
    with pytest.raises(UserError, match="is no baseline"):
        read_baseline(path)
    with pytest.raises(UserError, match="--update-baseline"):
        read_baseline(tmp_path / "none.json")


def test_an_event_must_come_between_its_times() -> None:
    event = ExpectedEvent("face_lost", 1.0, 2.0)
    said = [{"event": "face_lost", "time_s": 0.4}, {"event": "face_found", "time_s": 1.5}]
    missed = event.check(said)
    assert not missed.passed and missed.value == "0.40 s" and missed.rule == "1 to 2 s"
    assert event.check([*said, {"event": "face_lost", "time_s": 1.9}]).passed
    assert event.check([]).value is None


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ("event = 3", "event is not a list"),
        ("event = [{ kind = 'smile' }]", "kind is one of face_lost"),
        ("event = [{ kind = 'face_lost', between_s = [1] }]", "not a pair"),
        ("event = [{ kind = 'face_lost', between_s = [1, 2], at = 3 }]", "unknown keys: at"),
        ("tolerance.frame_bpz = 3", "no report has a figure frame_bpz"),
        ("original = 3", "original is not a path"),
    ],
)
def test_a_mistake_in_what_is_held_is_refused(more: str, reason: str, tmp_path: Path) -> None:
    text = f"[[clip]]\npath = 'a.mp4'\nsha256 = 'a'\n{more}"
    with pytest.raises(UserError, match=reason):
        read_suite(write_suite(tmp_path, text))


def test_recorded_calls_and_a_baseline_tell_a_changed_decoder(
    carphone: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    call, baseline = tmp_path / "a.rzo", tmp_path / "baseline.json"
    options = ["--profile", "thesis", "--max-frames", "8", "-q"]
    assert main(["encode", str(carphone), "-o", str(call), *options]) == 0
    sum_ = hashlib.sha256(call.read_bytes()).hexdigest()
    clip = f"path = 'a.rzo'\nsha256 = '{sum_}'\noriginal = '{carphone}'\nmin.frames = 8\n"
    event = "event = [{ kind = 'face_lost', between_s = [0, 9] }]"
    suite = write_suite(tmp_path, f"[[clip]]\n{clip}{event}")
    replay = ["replay", str(suite), "--out", str(tmp_path / "out"), "--baseline", str(baseline)]
    assert main(replay) == 2
    assert "--update-baseline writes one" in capsys.readouterr().err
    assert main([*replay, "--update-baseline"]) == 1
    printed = capsys.readouterr().out
    assert "pictures_sha256" in printed and printed.count("MISSED") == 1
    assert main([*replay, "--update-baseline"]) == 1
    assert "the baseline is as it was" in capsys.readouterr().out
    assert main(replay) == 1
    (missed,) = (line for line in capsys.readouterr().out.splitlines() if "MISSED" in line)
    assert "face_lost" in missed
    kept = json.loads(baseline.read_text())
    kept["clips"]["a.rzo"]["pictures_sha256"] = "0" * 64
    kept["clips"]["a.rzo"]["face_psnr_db"] += 1
    baseline.write_text(json.dumps(kept))
    assert main(replay) == 1
    assert capsys.readouterr().out.count("MISSED") == 3
