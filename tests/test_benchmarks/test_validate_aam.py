"""The validation of the AAM goes on where it was stopped, and only with what it was asked for."""

from pathlib import Path

import pytest

from benchmarks.validate_aam.__main__ import main, row_files, unfinished_parts, write_whole


def test_parts_whose_tables_are_there_are_passed_over(tmp_path: Path) -> None:
    parts = ["model", "search", "units"]
    assert unfinished_parts(tmp_path, parts, ["a"]) == parts
    write_whole(tmp_path / "search.md", "table")
    assert unfinished_parts(tmp_path, parts, ["a"]) == ["model", "units"]
    assert unfinished_parts(tmp_path, ["search"], ["a"]) == []
    assert unfinished_parts(tmp_path, parts, ["b"]) == parts
    assert not (tmp_path / "search.md").exists()


def test_the_lines_of_parts_that_are_done_are_gathered_in_their_order(tmp_path: Path) -> None:
    for name in ("units.rows.md", "units.md", "model.rows.md", "model.md", "search.rows.md"):
        write_whole(tmp_path / name, name)
    assert [path.name for path in row_files(tmp_path)] == ["model.rows.md", "units.rows.md"]


def test_faces_and_annotations_exclude_each_other(tmp_path: Path) -> None:
    for arguments in ([], ["--train", "x"], ["--faces", "x", "--train", "y", "--test", "z"]):
        with pytest.raises(SystemExit):
            main([*arguments, "-o", str(tmp_path)])
