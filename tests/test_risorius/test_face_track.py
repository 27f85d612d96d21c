"""Tracks: columns, action units, frames without a face, and the truth of an animation."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from processes import error_line

from risorius.animation.animate import animate
from risorius.cli import main
from risorius.face_track import (
    EAU_COLUMNS,
    POSE_COLUMNS,
    FaceTrack,
    action_unit_intensities,
    track,
)
from shared_model.errors import UserError
from shared_model.parameters import EAU_INDEX, EAUS

SCRIPT = """
width = 320
height = 240
fps = 25
seconds = 2
[[key]]
time = 0
pose = { yaw = 0, away = 0 }
eau = { jaw_drop = 0, mouth_corners = 0, lip_stretch = 0 }
[[key]]
time = 1
pose = { yaw = 15, away = 60 }
eau = { jaw_drop = 0.5, mouth_corners = 0.6, lip_stretch = -0.6 }
[[key]]
time = 2
pose = { yaw = 0, away = 0 }
eau = { jaw_drop = 0, mouth_corners = 0, lip_stretch = 0.6 }
"""


@pytest.fixture(scope="module")
def talking(networks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of two seconds; its truth has the same name."""
    folder = tmp_path_factory.mktemp("talking")
    (folder / "a.toml").write_text(SCRIPT)
    files = folder / "a.toml", folder / "a.mkv"
    animate(*files, lambda done, total: None, lambda: False)
    return folder / "a.mkv"


@pytest.fixture(scope="module")
def tracked(talking: Path) -> FaceTrack:
    return track(str(talking))


def test_a_track_follows_the_truth(talking: Path, tracked: FaceTrack) -> None:
    frames = json.loads(talking.with_suffix(".json").read_text())["frames"]
    angles = np.array([frame["pitch_yaw_roll_deg"] for frame in frames])
    eau = np.array([frame["eau"] for frame in frames])
    depth = np.array([frame["translation_mm"][2] for frame in frames])
    np.testing.assert_allclose(tracked.time_s, np.arange(50) / 25)
    assert np.abs(tracked.pose[:, :3] - angles).max() < 6
    assert np.corrcoef(tracked.pose[:, 5], depth)[0, 1] > 0.95
    for name in ("jaw_drop", "mouth_corners", "lip_stretch"):
        index = EAU_INDEX[name]
        assert np.corrcoef(tracked.eau[:, index], eau[:, index])[0, 1] > 0.9, name
    assert np.all((tracked.confidence > 0.8) & (tracked.confidence <= 1))


def test_a_table_has_a_line_for_each_frame_and_empty_cells_without_a_face() -> None:
    row = np.arange(20.0)
    rows = np.array([row, np.full(20, np.nan)])
    table = io.StringIO()
    found = FaceTrack(np.array([0, 0.04]), rows[:, :6], 0.01 * rows[:, 6:], np.array([0.9, 0]))
    np.testing.assert_array_equal(found.parameters[0], [*row[:6], *0.01 * row[6:]])
    found.write_csv(table)
    head, first, second = csv.reader(table.getvalue().splitlines())
    assert head[:7] == ["time_s", *POSE_COLUMNS] and head[7:21] == [*EAU_COLUMNS]
    assert head[21] == "AU1" and head[-1] == "confidence"
    assert first[:3] == ["0.0000", "0.0000", "1.0000"] and first[-1] == "0.9000"
    assert second[0] == "0.0400" and set(second[1:-1]) == {""} and second[-1] == "0.0000"


def test_action_units_are_the_ends_of_the_actuators() -> None:
    eau = np.zeros(len(EAUS))
    assert not any(action_unit_intensities(eau).values())
    eau[EAU_INDEX["mouth_corners"]] = -0.5
    eau[EAU_INDEX["lid_left"]], eau[EAU_INDEX["lid_right"]] = 1.0, 0.2
    eau[EAU_INDEX["lower_lip_lower"]] = -0.6
    units = action_unit_intensities(eau)
    moved = {name: float(value) for name, value in units.items() if value}
    assert moved == {"AU15": 0.5, "AU17": 1.0, "AU45": 1.0}
    assert [*units][:3] == ["AU1", "AU2", "AU4"]


def test_the_command_writes_a_file_or_prints(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, line = tmp_path / "me.csv", ["track", str(carphone), "--max-frames", "4", "-q"]
    assert main([*line, "-o", str(path)]) == 0
    assert main(line) == 0
    assert capsys.readouterr().out == path.read_text()
    assert len(path.read_text().splitlines()) == 5


def test_a_video_without_a_face_has_no_track(
    noise: Path, networks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", str(noise), "-o", str(tmp_path / "a.csv")]) == 3
    assert "no face found in 8 frames" in error_line(capsys)
    assert not list(tmp_path.iterdir())


def test_a_track_as_json_has_the_numbers_of_the_csv(tracked: FaceTrack, tmp_path: Path) -> None:
    tracked.write(tmp_path / "t.json")
    tracked.write(tmp_path / "t.csv")
    found = json.loads((tmp_path / "t.json").read_text())
    with (tmp_path / "t.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert found["columns"] == list(lines[0]) and len(found["frames"]) == len(lines)
    for frame, line in zip(found["frames"], lines, strict=True):
        assert [frame[name] for name in line] == [float(text) for text in line.values()]


def test_a_track_in_the_columns_of_openface(tracked: FaceTrack, tmp_path: Path) -> None:
    tracked.write(tmp_path / "t.csv", "openface")
    with (tmp_path / "t.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0])[:11] == [
        *("frame", "face_id", "timestamp", "confidence", "success"),
        *("pose_Tx", "pose_Ty", "pose_Tz", "pose_Rx", "pose_Ry", "pose_Rz"),
    ]
    assert {"AU01_r", "AU26_r", "AU45_r", "AU12_c"} <= set(lines[0])
    middle = lines[len(lines) // 2]
    assert middle["frame"] == "26" and middle["success"] == "1"
    # At one second the head is turned by 15 degrees to the subject's left, the jaw half open.
    assert float(middle["pose_Ry"]) == pytest.approx(-np.radians(15), abs=0.05)
    assert float(middle["AU26_r"]) == pytest.approx(2.5, abs=0.8) and middle["AU26_c"] == "1"
    assert lines[0]["AU26_c"] == "0"


@pytest.mark.parametrize("kind", ["csv", "openface", "json"])
def test_no_number_is_minus_zero(kind: str, tmp_path: Path) -> None:
    small = -0.00001
    rows = np.full((2, len(EAU_COLUMNS)), small)
    found = FaceTrack(np.zeros(2), np.full((2, 6), small), rows, np.ones(2))
    found.write(tmp_path / "t", kind)
    assert "-0.0000" not in (tmp_path / "t").read_text()
    assert "-0.0," not in (tmp_path / "t").read_text()


def test_the_suffix_and_the_option_say_what_is_written(talking: Path, tmp_path: Path) -> None:
    output = tmp_path / "t.json"
    line = ["track", str(talking), "-o", str(output), "--max-frames", "3", "-q"]
    assert main(line) == 0 and len(json.loads(output.read_text())["frames"]) == 3
    assert main([*line, "--format", "openface"]) == 0
    assert output.read_text().startswith("frame,face_id,timestamp")


def test_a_full_disk_leaves_an_older_track(tracked: FaceTrack, tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    path = tmp_path / "t.csv"
    path.write_text("older")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
    try:
        with pytest.raises(UserError, match="File too large"):
            tracked.write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "older" and list(tmp_path.iterdir()) == [path]
