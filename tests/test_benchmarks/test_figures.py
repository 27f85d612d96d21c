"""Tables of docs/measurements.md: each set's figures go between its own marks."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks.figures import (
    COLUMNS,
    DURATIONS_S,
    MEASUREMENTS,
    SETS,
    commands,
    is_whole,
    markdown,
    marks,
    replaced,
)
from loopback.bench import AVERAGED_FIGURES
from loopback.curves.contenders import Rung
from loopback.curves.curve_bench import CurveSettings, curve_report
from loopback.curves.points import Point


def report(psnr: float | None) -> dict[str, Any]:
    clip: dict[str, Any] = dict.fromkeys([*COLUMNS, *AVERAGED_FIGURES])
    clip |= {"source": "a.mp4", "model_bytes": 11021, "frame_bps": 800.0, "face_psnr_db": psnr}
    return {"clips": [clip]}


def test_the_table_says_each_figure_and_the_means() -> None:
    lines = markdown("recorded", [report(34.07)]).splitlines()
    assert lines[0] == "    risorius bench --no-pace CLIP... --max-frames 300"
    assert lines[4].startswith("| a | 34.1 | - |") and lines[4].endswith("| 11021 | 800 |")
    assert lines[5].startswith("| **mean** | 34.1 | - |")
    assert len({line.count("|") for line in lines[2:]}) == 1
    assert "in haste" in markdown("busy", [report(30)]).splitlines()[2]


def test_ways_of_a_profile_are_rows_of_one_table() -> None:
    reports = [report(20.0 + number) for number in range(len(SETS["thesis"]))]
    first, *others = markdown("thesis", reports).splitlines()
    assert first.startswith(
        "    risorius bench --profile thesis --no-pace CLIP... --max-frames 300"
    )
    assert first.endswith("# thesis") and others[2].endswith("# thesis-literal")
    header, _, *rows = (line for line in others if line.startswith("|"))
    assert header.endswith("| frames, bit/s | a |")
    assert rows[0].startswith("| thesis | 20.0 | - |") and rows[0].endswith("| 800 | 20.0 |")
    assert rows[3].startswith("| thesis-literal | 23.0 |")
    assert len({line.count("|") for line in (header, *rows)}) == 1


def test_the_curves_are_rungs_and_duels() -> None:
    def figures(value: float) -> dict[str, float]:
        names = ("face_psnr_db", "face_ssimulacra2", "full_psnr_db", "picture_ssimulacra2")
        return dict.fromkeys(names, value)

    clips = {
        "a": {
            "risorius": [Point("800 bit/s", 12_000, 790, figures(34))],
            "x264": [
                Point("crf 51", 900, 8000, figures(30)),
                Point("crf 30", 900, 64_000, figures(40)),
            ],
        }
    }
    content = curve_report(clips, CurveSettings((Rung(800),), ("x264",)), [])
    lines = markdown("curves", [content]).splitlines()
    assert "| 800 bit/s | 12.0 | 790 | 34.0 | 34 | 34.0 | 34 |" in lines
    assert sum(line.startswith("| x264 | ") for line in lines) == len(DURATIONS_S) == 2
    assert "--against svtav1,x265,x264,vp9 CLIP... --max-frames 150" in lines[0]


def test_a_set_leaves_the_other_ones_table_alone() -> None:
    text = "".join(f"x\n{''.join(marks(name))}" for name in ("thesis", "recorded"))
    once = replaced(text, "thesis", "24.0\n")
    both = replaced(once, "recorded", "35.0\n")
    assert "24.0" in once.split(marks("thesis")[1])[0]
    assert both.startswith(once.split(marks("recorded")[0])[0])
    assert replaced(both, "recorded", "35.0\n") == both


@pytest.mark.parametrize("name", SETS)
def test_the_document_has_a_place_for_each_set(name: str) -> None:
    begin, end = marks(name)
    text = MEASUREMENTS.read_text(encoding="utf-8")
    assert text.count(begin) == text.count(end) == 1
    assert text.index(begin) < text.index(end)


def test_a_report_that_was_broken_off_is_measured_again(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    assert not is_whole(report, 2)
    report.write_text('{"clips": [{"clip": "a.mp4"}]}', encoding="utf-8")
    assert not is_whole(report, 2) and is_whole(report, 1)


def test_the_document_is_short() -> None:
    assert len(MEASUREMENTS.read_text(encoding="utf-8").splitlines()) <= 200


def test_a_set_is_measured_by_a_bench() -> None:
    [(folder, command)] = commands("busy", ["a.mp4"], Path("out")).items()
    assert folder == Path("out/busy")
    assert command == [
        *("bench", "--live", "--busy", "1", "a.mp4", "--max-frames", "300", "--out", "out/busy")
    ]


def test_the_thesis_profile_is_measured_without_a_network_too() -> None:
    first, *_, literal = commands("thesis", ["a.mp4"], Path("out")).values()
    assert first[1:3] == ["--profile", "thesis"] and first[-1] == "out/thesis"
    assert literal[1:3] == ["--preset", "thesis-literal"] and literal[-1] == "out/thesis-literal"
