"""Scripts run as `python -m scripts.NAME`, explain themselves, and write only what is asked for."""

import hashlib
import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

HEAD = ROOT / "shared_model" / "data" / "head.npz"
# Not commands but parts of them.
PARTS = {"command", "fitted_clip", "line_charts", "model_tables"}
SCRIPTS = sorted(path.stem for path in (ROOT / "scripts").glob("*.py") if path.stem not in PARTS)


def run(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", f"scripts.{name}", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_script_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(f"scripts.{name}").main(["--help"])
    assert stop.value.code == 0
    assert "usage:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("long_run", ["nosuch.mp4", "out.mkv"]),
        ("model_figures", ["--reference", "nosuch.npz"]),
        ("measurement_tables", ["nosuch.json"]),
        ("enlarged_landmarks", ["nosuch", "-o", "nosuch.csv"]),
    ],
)
def test_what_is_not_there_is_one_line(name: str, arguments: list[str]) -> None:
    result = run(name, *arguments)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "nosuch" in line


def test_docs_run_scripts_as_modules() -> None:
    texts = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("scripts/*.py")]
    assert not [path.name for path in texts if "python scripts/" in path.read_text()]


def test_a_head_is_written_only_where_asked() -> None:
    before = hashlib.sha256(HEAD.read_bytes()).hexdigest()
    result = run("build_head")
    assert result.returncode == 2 and "--output" in result.stderr
    assert hashlib.sha256(HEAD.read_bytes()).hexdigest() == before


def test_fields_are_computed_anew_in_the_head_that_is_named(tmp_path: Path) -> None:
    copy = tmp_path / "head.npz"
    shutil.copy(HEAD, copy)
    assert run("build_head", "--fields-only", "--output", str(copy)).returncode == 0
    with np.load(HEAD) as ours, np.load(copy) as theirs:
        assert all(np.array_equal(ours[name], theirs[name]) for name in ours.files)


def test_the_folder_for_training_faces_is_made(tmp_path: Path) -> None:
    output = tmp_path / "calls" / "of" / "faces"
    importlib.import_module("scripts.training_faces.__main__").main(
        ["none", str(output), "--count=0"]
    )
    assert output.is_dir()
