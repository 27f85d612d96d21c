"""What makes the data writes only what is asked for, where it is asked to."""

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


def run(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", f"assets.{name}", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["build_head", "head_figures", "model_figures"])
def test_each_program_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        importlib.import_module(f"assets.{name}").main(["--help"])
    assert stop.value.code == 0
    assert "usage:" in capsys.readouterr().out


def test_a_reference_that_is_not_there_is_one_line() -> None:
    result = run("model_figures", "--reference", "nosuch.npz")
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "nosuch" in line


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
    importlib.import_module("assets.training_faces.__main__").main(
        ["none", str(output), "--count=0"]
    )
    assert output.is_dir()
