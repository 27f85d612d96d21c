"""Benchmarks run as `python -m benchmarks NAME` and say in a line what is wrong."""

import subprocess
import sys

import pytest
from conftest import ROOT

from benchmarks.__main__ import programs, summary


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "benchmarks", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)


def test_all_are_listed_with_what_they_measure() -> None:
    listed = run("--help").stdout
    assert len(programs()) > 20
    for name, path in programs().items():
        assert f"  {name} " in listed and summary(path) in listed and summary(path)


def test_one_explains_itself_under_the_name_it_is_called_by() -> None:
    result = run("full_rate", "--help")
    assert result.returncode == 0 and "usage:" in result.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["nosuch"],
        ["full_rate", "nosuch.mp4", "out.mkv"],
        ["figures", "nosuch.mp4"],
        ["enlarged_landmarks", "nosuch", "-o", "nosuch.csv"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_what_is_not_there_is_one_line(arguments: list[str]) -> None:
    result = run(*arguments)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "nosuch" in line


def test_documents_run_benchmarks_as_modules() -> None:
    texts = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.py")]
    assert not [path.name for path in texts if "python benchmarks/" in path.read_text()]
