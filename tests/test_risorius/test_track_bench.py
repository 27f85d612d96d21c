"""The tracker against what is known: files as the databases have them, made here."""

import json
from pathlib import Path

import numpy as np
import pytest
from processes import error_line

from risorius.animation.animate import animate
from risorius.cli import main
from risorius.track_bench.pose_errors import compare_poses
from risorius.track_bench.pose_truth import find_pose_truth
from risorius.track_bench.track_bench import compare_expressions
from risorius.track_bench.truth_files import matching_key, source_names
from risorius.track_bench.unit_labels import UnitLabels, find_unit_labels
from risorius.track_bench.unit_scores import unit_scores
from shared_model.anatomy.expressions import EMOTIONS
from shared_model.arrays import Array
from shared_model.errors import UserError
from shared_model.geometry import FRONTAL, euler_deg, matrix_from_quaternion, pose_from_euler
from shared_model.parameters import EAUS, Pose

TURNS = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, -15.0]])
SCRIPT = """
width = 320
height = 240
seconds = 2
[[key]]
time = 0
pose = { yaw = -12, pitch = 0 }
eau = { jaw_drop = 0 }
[[key]]
time = 2
pose = { yaw = 12, pitch = 5 }
eau = { jaw_drop = 0.6 }
"""


def turned(turn: Array) -> Array:
    """(4,) `camera_from_head` of pitch, yaw and roll, degrees."""
    pitch, yaw, roll = turn
    return pose_from_euler(pitch, yaw, roll, np.zeros(3)).rotation


def write_bu(path: Path, turns: Array) -> None:
    """A line of the sensor at rest, then one for each frame: number, place, roll, yaw, pitch."""
    pitch, yaw, roll = turns.T
    place = np.tile([1.0, 2.0, 30.0], (len(turns), 1))
    rows = np.column_stack([np.arange(len(turns)), place, roll, yaw, -pitch])
    np.savetxt(path, np.vstack([np.full(7, 9.0), rows]), fmt="%.4f")


def write_biwi(folder: Path, turns: Array) -> None:
    """A matrix and a place for each frame, from number 3 on as in the database."""
    folder.mkdir(parents=True)
    for number, turn in enumerate(turns, start=3):
        rotation = turned(turn)
        matrix = matrix_from_quaternion(rotation) @ matrix_from_quaternion(np.array(FRONTAL))
        lines = [" ".join(f"{v:.6f}" for v in row) for row in [*matrix, [40.0, -30.0, 900.0]]]
        text = "\n".join([*lines[:3], "", lines[3], ""])
        (folder / f"frame_{number:05d}_pose.txt").write_text(text)


def angles(rotation: Array) -> Array:
    return np.array([euler_deg(Pose(each, np.zeros(3))) for each in rotation])


def test_files_of_a_recording_are_found_by_its_name() -> None:
    assert source_names("a/S005/001/S005_001_%08d.png@30") == ("S005_001", "001")
    assert matching_key("v/LeftVideoSN001_comp.avi", ["SN0", "SN001", "SN01"]) == "SN001"
    assert matching_key("v/jam1.avi", ["jam1", "jam11"]) == "jam1"
    assert matching_key("hpdb/01/frame_%05d_rgb.png", ["01", "02"]) == "01"
    assert matching_key("v/jam2.avi", ["jam", "jam1"]) is None


def test_poses_of_bu_and_biwi_have_our_signs(tmp_path: Path) -> None:
    write_bu(tmp_path / "jam1.dat", TURNS)
    write_biwi(tmp_path / "hpdb" / "01", TURNS)
    bu, biwi = (find_pose_truth(tmp_path, name) for name in ("jam1.avi", "x/01/frame_%05d_rgb.png"))
    assert (bu.kind, biwi.kind) == ("BU", "BIWI")
    np.testing.assert_allclose(angles(bu.rotation), TURNS, atol=1e-3)
    np.testing.assert_allclose(angles(biwi.rotation), TURNS, atol=1e-3)


def test_a_matrix_of_biwi_turns_a_head_that_looks_into_the_camera(tmp_path: Path) -> None:
    # About the camera's vertical axis, y down: the nose (0, 0, -1) goes to the picture's left,
    # which is the subject's right.
    (tmp_path / "01").mkdir()
    sine, cosine = np.sin(0.3), np.cos(0.3)
    matrix = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    assert (matrix @ [0, 0, -1])[0] < 0
    np.savetxt(tmp_path / "01" / "frame_00003_pose.txt", matrix)
    found = find_pose_truth(tmp_path, "01/frame_%05d_rgb.png").rotation
    assert angles(found)[0] == pytest.approx([0, -np.degrees(0.3), 0], abs=1e-6)


def test_poses_are_compared_by_their_turn_from_the_first_face() -> None:
    away = [4.0, -7.0, 3.0]
    true = np.array([turned(turn) for turn in TURNS])
    first = np.full((1, 3), np.nan)
    same = compare_poses(np.vstack([first, TURNS[1:]]), true)
    assert same.found_share == 0.75 and np.nanmax(np.abs(same.found - same.truth)) < 1e-9
    off = compare_poses(TURNS + np.array([[0, 0, 0], away, away, away]), true)
    np.testing.assert_allclose(off.mean_deg, 0.75 * np.abs(away), atol=1e-9)
    np.testing.assert_allclose(off.rms_deg, np.sqrt(0.75) * np.abs(away), atol=1e-9)


def test_actuators_are_compared_where_there_is_a_face() -> None:
    truth = np.stack([np.zeros(len(EAUS)), *(each.peak() for each in EMOTIONS)])
    found = truth.copy()
    found[1], found[2] = np.nan, 0
    compared = compare_expressions(found, np.vstack([truth, truth]))
    assert compared.same_emotion == pytest.approx(5 / 6)
    anger = EMOTIONS[1].peak()
    np.testing.assert_allclose(compared.rms, np.abs(anger) / np.sqrt(6), atol=1e-12)


def test_labels_of_disfa_count_from_an_intensity_of_two(tmp_path: Path) -> None:
    folder = tmp_path / "SN001"
    folder.mkdir()
    for unit, values in ((12, (0, 1, 2, 5)), (4, (0, 0, 3, 0))):
        lines = [f"{number},{value}" for number, value in enumerate(values, start=1)]
        (folder / f"SN001_au{unit}.txt").write_text("\n".join(lines))
    found = find_unit_labels(tmp_path, "LeftVideoSN001_comp.avi")
    assert found.frames.tolist() == [0, 1, 2, 3] and not found.is_complete
    assert found.shown["AU12"].tolist() == [False, False, True, True]
    assert found.shown["AU4"].tolist() == [False, False, True, False]


def test_labels_of_ck_are_of_the_last_frame_and_the_first_is_neutral(tmp_path: Path) -> None:
    folder = tmp_path / "FACS" / "S005" / "001"
    folder.mkdir(parents=True)
    text = "   1.2000000e+01   3.0000000e+00\n   2.6000000e+01   0.0000000e+00\n"
    (folder / "S005_001_00000011_facs.txt").write_text(text)
    found = find_unit_labels(tmp_path, "S005/001/S005_001_%08d.png")
    assert found.frames.tolist() == [0, 10] and found.is_complete
    assert {unit: each.tolist() for unit, each in found.shown.items()} == {
        "AU12": [False, True],
        "AU26": [False, True],
    }


def test_labels_of_mmi_are_all_phases_but_the_neutral_one(tmp_path: Path) -> None:
    markers = "".join(
        f'<Marker Frame="{frame}" Type="{kind}"/>'
        for frame, kind in ((1, 0), (3, 1), (5, 2), (8, 0))
    )
    one = '<ActionUnit Number="L12"><Marker Frame="10" Type="0"/></ActionUnit>'
    text = f'<Annotation><ActionUnit Number="12">{markers}</ActionUnit>{one}</Annotation>'
    (tmp_path / "S001-001-oao_aucs.xml").write_text(text)
    found = find_unit_labels(tmp_path, "S001-001.avi")
    assert found.frames.tolist() == [*range(10)]
    assert np.flatnonzero(found.shown["AU12"]).tolist() == [2, 3, 4, 5, 6]


def test_a_table_of_openface_counts_presences_before_intensities(tmp_path: Path) -> None:
    lines = ["frame, timestamp, AU12_r, AU12_c, AU04_r", "1, 0, 4.0, 0, 0.5", "2, 0.03, 0, 1, 1.5"]
    (tmp_path / "me.csv").write_text("\n".join(lines))
    found = find_unit_labels(tmp_path / "me.csv", "whatever.mp4")
    assert found.shown["AU12"].tolist() == [False, True]
    assert found.shown["AU4"].tolist() == [False, True]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("me.csv", "frame,jaw\n1,2\n"),
        ("me.csv", ""),
        ("me-oao_aucs.xml", "<Annotation></Annotation>"),
        ("me-oao_aucs.xml", "no"),
        ("me_au12.txt", "1,2,3\n"),
        ("me_au12.txt", "a,b\n"),
    ],
)
def test_labels_that_are_none_are_told(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(UserError, match="not labels of action units"):
        find_unit_labels(tmp_path, "me.mp4")


def test_scores_are_those_of_all_frames_of_all_clips() -> None:
    first = {"AU12": np.array([0.0, 0.5, np.nan, 0.9]), "AU4": np.zeros(4)}
    coded = UnitLabels(np.arange(4), {"AU12": np.array([False, True, True, True])})
    ck = UnitLabels(np.array([0, 1, 7]), {"AU4": np.array([False, True, True])}, is_complete=True)
    second = {"AU12": np.array([0.3, 0.0]), "AU4": np.array([0.0, 1.0])}
    scores = unit_scores([(first, coded), (second, ck)])
    smile, brow = scores["AU12"], scores["AU4"]
    # Frame 7 of the second clip was not tracked; its AU12 was coded as absent.
    assert (smile.judged, smile.shown, brow.judged, brow.shown) == (6, 3, 2, 1)
    assert (smile.recall, smile.precision, smile.f1) == pytest.approx((2 / 3, 2 / 3, 2 / 3))
    assert smile.auc == pytest.approx((3 + 3 + 1) / 9) and (brow.f1, brow.auc) == (1, 1)


def test_the_command_tracks_and_compares_with_the_truth_of_an_animation(
    networks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.toml").write_text(SCRIPT)
    files = tmp_path / "a.toml", tmp_path / "a.mkv"
    animate(*files, lambda done, total: None, lambda: False)
    labels = tmp_path / "labels"
    labels.mkdir()
    lines = [f"{number},{5 * (number > 25)}" for number in range(1, 51)]
    (labels / "a_au26.txt").write_text("\n".join(lines))
    out = tmp_path / "out"
    asked = ["--pose-truth", str(tmp_path / "a.json"), "--labels", str(labels)]
    assert main(["bench", str(tmp_path / "a.mkv"), *asked, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())
    clip = report["clips"][0]
    assert clip["frames"] == 50 and clip["found"] == 1
    assert clip["eau_rms"]["jaw_drop"] < 0.15 and clip["same_emotion"] > 0.5
    assert clip["yaw_mean_deg"] < 3 and clip["pitch_rms_deg"] < 3
    assert report["units"]["AU26"]["auc"] > 0.95
    assert "rms yaw" in said and "AU26" in said
    assert {"a.csv", "a.svg"} <= {path.name for path in out.iterdir()}


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        (["--pose-truth", "nowhere"], "no such file"),
        (["--pose-truth", ".", "--live"], "--live does not go with --pose-truth"),
        (["--labels", ".", "--sweep", "800"], "does not go with --labels"),
    ],
)
def test_what_cannot_be_compared_is_one_line(
    more: list[str], complaint: str, noise: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", str(noise), *more]) == 2
    assert complaint in error_line(capsys)
