"""The script that holds the time of each stage against fixed work."""

from pathlib import Path

import pytest
from shots import draw, talking

from benchmarks.speed_ratios.__main__ import main, slower_stages


def test_a_stage_that_has_become_slower_is_named(
    networks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draw(tmp_path / "clip.mkv", talking(1.24))
    expected = tmp_path / "expected.toml"
    expected.write_text('"encoder, live, fit" = 0.0001\n"encoder, recorded, fit" = 10000.0\n')
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path / "clip.mkv"), "--max-frames", "14", "--expected", str(expected)])
    *rows, last = capsys.readouterr().out.splitlines()
    assert ended.value.code == 1
    assert last == "slower than 1.5 times what is expected: encoder, live, fit"
    assert any(row.startswith("decoder, live, ") for row in rows)
    assert any(row.startswith("decoder, recorded, ") for row in rows)


def test_only_what_exceeds_the_tolerance_is_slower_and_new_stages_are_not() -> None:
    ratios = {"a": 1.4, "b": 1.6, "new": 9.0}
    assert slower_stages(ratios, {"a": 1.0, "b": 1.0}) == ["b"]
