"""Outputs are refused before the work, not after it."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from risorius.cli import main
from risorius.command_line.output_checks import STANDARD, check_output_folder, check_outputs
from shared_model.errors import UserError, cannot_write

Capture = pytest.CaptureFixture[str]


def test_what_can_be_written_passes(tmp_path: Path) -> None:
    old = tmp_path / "old.mkv"
    old.write_bytes(b"")
    check_outputs(["me.mp4", None, "0"], [old, tmp_path / "%04d.png", None, STANDARD])


def test_an_input_is_no_output(tmp_path: Path) -> None:
    path = tmp_path / "me.mp4"
    path.write_bytes(b"")
    with pytest.raises(UserError, match="is what is to be read"):
        check_outputs([str(path)], [tmp_path / "." / "me.mp4"])


def test_a_pattern_of_images_is_not_read_and_written(tmp_path: Path) -> None:
    pattern = tmp_path / "frame%04d.png"
    with pytest.raises(UserError, match="is what is to be read"):
        check_outputs([str(pattern)], [tmp_path / "." / pattern.name])


def test_two_outputs_are_two_files(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="named for two outputs"):
        check_outputs([], [tmp_path / "a.mkv", tmp_path / "a.mkv"])


@pytest.mark.parametrize(("path", "kind"), [("/dev/null", "no regular file"), (".", "a folder")])
def test_folders_and_devices_are_no_outputs(path: str, kind: str) -> None:
    with pytest.raises(UserError, match=kind):
        check_outputs([], [Path(path)])


@pytest.mark.parametrize(
    "line",
    [
        "encode me.mp4 -o a.rzo --report none/r.json",
        "decode a.rzo --report none/r.json",
        "animate a.toml -o a.mkv --truth none/t.json",
        "encode me.mp4 -o none/a.rzo",
        "encode me.mp4 -o .",
    ],
)
def test_every_command_looks_first(line: str, capsys: Capture) -> None:
    assert main(line.split()) == 2
    (complaint,) = capsys.readouterr().err.splitlines()
    assert "folder" in complaint


@pytest.mark.parametrize("name", ["call.mp4", "call.MKV", "call%04d.png"])
def test_a_call_is_not_written_under_a_videos_name(name: str, capsys: Capture) -> None:
    assert main(["encode", "me.mp4", "-o", name]) == 2
    (complaint,) = capsys.readouterr().err.splitlines()
    assert "a call is no video" in complaint and ".rzo and decode that" in complaint


def test_a_folder_may_be_made_but_is_no_file(tmp_path: Path) -> None:
    check_output_folder(None)
    check_output_folder(tmp_path / "new" / "report")
    (tmp_path / "file").write_bytes(b"")
    for folder in (tmp_path / "file", tmp_path / "file" / "report"):
        with pytest.raises(UserError, match="is no folder"):
            check_output_folder(folder)


def test_a_report_is_checked_before_the_training(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "file").write_bytes(b"")
    model = ["-o", str(tmp_path / "model.npz"), "--report", str(tmp_path / "file")]
    assert main(["train", str(tmp_path), *model]) == 2
    assert "is no folder" in capsys.readouterr().err


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A folder on a file system that is read-only."""
    options = ["-t", "tmpfs", "-o", "ro", "tmpfs"]
    if os.geteuid() or subprocess.run(["mount", *options, tmp_path], check=False).returncode:
        pytest.skip("nothing may be mounted here")
    yield tmp_path
    subprocess.run(["umount", tmp_path], check=True)


@pytest.mark.parametrize(
    "line",
    [
        "decode a.rzo -o {}/x.mkv",
        "decode a.rzo -o {}/f%04d.png",
        "encode a.mp4 -o {}/x.rzo",
        "animate a.toml -o {}/x.mkv",
        "train annotated -o {}/m.npz",
        "bench a.mp4 --out {}/d",
        "bench a.mp4 --sweep 800 --out {}/d",
        "keys new {}/k --host relay.example",
    ],
)
def test_a_read_only_file_system_is_said_before_the_work(
    line: str, read_only: Path, capsys: Capture
) -> None:
    assert main(line.format(read_only).split()) == 2
    (complaint,) = capsys.readouterr().err.splitlines()
    assert complaint.startswith("risorius: cannot write ")
    assert complaint.endswith(": Read-only file system")


def test_a_folder_that_takes_no_files_is_not_called_missing() -> None:
    with pytest.raises(UserError, match="no file can be made there"):
        raise cannot_write(Path("/x"), FileNotFoundError())
