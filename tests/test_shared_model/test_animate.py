"""Drawing a script: the picture agrees with the truth that is written beside it."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from call_files import call_file

from protocol.call_file import CallWriter
from protocol.packets import ControlKind, ControlPacket, serialise
from risorius.animation.animate import animate, degrade, side_light
from risorius.animation.animation_script import parse_script
from risorius.animation.synthetic_skin import painted_colours
from risorius.cli import main
from shared_model.animate import Face, Identity
from shared_model.arrays import Picture
from shared_model.errors import UserError
from shared_model.geometry import Camera, normalise, pixel_from_head
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, Pose

SCRIPT = """
width = 160
height = 120
fps = 10
seconds = 0.4
distance_mm = 700
[[key]]
time = 0
eau = { jaw_drop = 0, lid_left = 0 }
pose = { yaw = 0 }
[[key]]
time = 0.3
eau = { jaw_drop = 1, lid_left = 1 }
pose = { yaw = 30, right = 40 }
aau = { nose_width = 1 }
"""


def run(folder: Path, text: str = SCRIPT, **options: Any) -> tuple[list[Picture], dict[str, Any]]:
    script = folder / "script.toml"
    script.write_text(text)
    output = folder / "f%02d.png"
    report = animate(script, output, lambda *_: None, lambda: False, **options)
    pictures = [cv2.imread(str(folder / f"f{i:02d}.png")) for i in range(report.frames)]
    assert all(picture is not None for picture in pictures)
    return [np.asarray(p, dtype=np.uint8) for p in pictures], json.loads(report.truth.read_text())


def test_one_picture_and_one_truth_for_each_frame(tmp_path: Path) -> None:
    pictures, truth = run(tmp_path)
    assert len(pictures) == len(truth["frames"]) == 4
    assert pictures[0].shape == (120, 160, 3) and truth["fps"] == [10, 1]
    assert not np.array_equal(pictures[0], pictures[3])


def test_truth_projects_to_its_own_landmarks(tmp_path: Path) -> None:
    _, truth = run(tmp_path)
    head = generic_head()
    for frame in truth["frames"]:
        pose = Pose(normalise(np.array(frame["rotation"])), np.array(frame["translation_mm"]))
        identity = Identity(np.array(frame["aau"]), np.zeros_like(head.vertices))
        vertices = Face(head, identity).animate(np.array(frame["eau"]))
        camera = Camera(truth["width"], truth["height"], frame["focal_px"])
        pixels = pixel_from_head(camera, pose, vertices)
        for name, place in frame["landmarks_px"].items():
            np.testing.assert_allclose(pixels[head.landmarks[name]], place, atol=0.02)
    assert truth["frames"][3]["pitch_yaw_roll_deg"][1] == pytest.approx(30, abs=1e-3)
    assert truth["frames"][3]["aau"][AAUS.index("nose_width")] == 1


def test_the_pupils_are_drawn_where_the_truth_has_them(tmp_path: Path) -> None:
    text = SCRIPT.replace("width = 160", "width = 320").replace("height = 120", "height = 240")
    pictures, truth = run(tmp_path, text)
    left, right = (np.array(truth["frames"][0]["landmarks_px"][f"ex_{side}"]) for side in "lr")
    middle = np.rint((left + right) / 2).astype(int)
    eye = np.rint((left + np.array(truth["frames"][0]["landmarks_px"]["en_l"])) / 2).astype(int)
    grey = pictures[0].mean(2)
    assert grey[eye[1] - 3 : eye[1] + 4, eye[0] - 3 : eye[0] + 4].min() < 40
    assert grey[middle[1], middle[0]] > 80


def test_the_same_script_gives_the_same_pictures(tmp_path: Path) -> None:
    for folder in "ab":
        (tmp_path / folder).mkdir()
    noisy = "noise = 3\nblur_px = 0.7\nseed = 4\n" + SCRIPT
    first, second = run(tmp_path / "a", noisy)[0], run(tmp_path / "b", noisy)[0]
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_background_shows_around_the_head_only(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((60, 80, 3), (200, 40, 90), np.uint8))
    with_wall, truth = run(tmp_path, 'background = "wall.png"\n' + SCRIPT)
    np.testing.assert_allclose(with_wall[0][2, 2], (200, 40, 90), atol=2)
    nose = np.rint(truth["frames"][0]["landmarks_px"]["prn"]).astype(int)
    assert abs(int(with_wall[0][nose[1], nose[0], 0]) - 200) > 20


@pytest.mark.parametrize(
    ("content", "reason"),
    [(None, "no such file"), (b"", "not a picture"), (b"no picture at all", "not a picture")],
)
def test_a_background_that_cannot_be_read_is_one_line(
    content: bytes | None, reason: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    script, wall = tmp_path / "script.toml", tmp_path / "wall.png"
    script.write_text('background = "wall.png"\n' + SCRIPT)
    if content is not None:
        wall.write_bytes(content)
    assert main(["animate", str(script), "-o", str(tmp_path / "out.mkv"), "-q"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("risorius: ") and reason in line and "wall.png" in line


def test_light_blur_and_noise_are_as_asked() -> None:
    picture = np.full((40, 60, 3), 100, np.uint8)
    script = parse_script(
        {"noise": 4, "key": [{"time": 0, "light": {"side": 1, "brightness": 1.2}}]}, Path()
    )
    out = degrade(picture, script, script.at(0), np.random.default_rng(0)).astype(float)
    assert out[:, 50:].mean() > 150 and out[:, :10].mean() < 90
    np.testing.assert_allclose(out.std(axis=0).mean(), 4, atol=0.6)
    np.testing.assert_allclose(side_light(5, -1), [1.5, 1.25, 1, 0.75, 0.5])


def test_mottled_skin_differs_from_plain_skin_on_the_skin_only() -> None:
    head = generic_head()
    plain, mottled = painted_colours(head), painted_colours(head, 0.1, 3)
    changed = (plain != mottled).any(1)
    assert changed.mean() > 0.3 and not changed[head.parts != 0].any()


def test_a_caller_wears_their_own_texture_before_their_own_wall(tmp_path: Path) -> None:
    caller = call_file(tmp_path / "call.rzo")
    text = SCRIPT.replace("aau = { nose_width = 1 }", "")
    pictures, truth = run(tmp_path, text, call_file=caller)
    assert truth["call"] == "call.rzo" and truth["frames"][0]["translation_mm"] == [40, 0, 600]
    nose = np.rint(truth["frames"][0]["landmarks_px"]["prn"]).astype(int)
    assert pictures[0][nose[1], nose[0]].argmax() == 1
    assert pictures[0][3, 3].argmax() == 0
    assert truth["frames"][3]["pitch_yaw_roll_deg"][1] == pytest.approx(30, abs=1e-3)


def test_a_call_without_a_model_has_nobody_to_animate(tmp_path: Path) -> None:
    empty = tmp_path / "empty.rzo"
    with CallWriter(empty) as writer:
        writer.send(serialise(ControlPacket(0, ControlKind.END, 0)))
    with pytest.raises(UserError, match="nobody to draw"):
        run(tmp_path, SCRIPT.replace("aau = { nose_width = 1 }", ""), call_file=empty)


def test_a_callers_camera_is_their_own(tmp_path: Path) -> None:
    text = SCRIPT + "camera = { zoom = 2 }"
    with pytest.raises(UserError, match="a call has its own camera"):
        run(tmp_path, text, call_file=tmp_path / "call.rzo")


def test_a_callers_shape_changes_from_their_own(tmp_path: Path) -> None:
    caller = call_file(tmp_path / "call.rzo")
    text = "[[key]]\ntime = 0\naau = { cranial_width = %d }\n"
    own, wide = (run(tmp_path, "seconds = 0.04\n" + text % v, call_file=caller) for v in (0, 1))

    def width_px(truth: dict[str, Any]) -> float:
        left, right = (truth["frames"][0]["landmarks_px"][f"t_{side}"][0] for side in "lr")
        return float(left - right)

    assert width_px(wide[1]) > 1.03 * width_px(own[1])
    assert not np.array_equal(own[0][0], wide[0][0])


def test_a_head_behind_the_camera_is_the_scripts_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="brings the head to"):
        run(tmp_path, SCRIPT.replace("right = 40", "away = -690"))


def test_the_command_writes_both_files_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "script.toml"
    script.write_text(SCRIPT)
    assert main(["animate", str(script), "-o", str(tmp_path / "out.mkv")]) == 0
    assert "4 pictures" in capsys.readouterr().out
    assert (tmp_path / "out.mkv").stat().st_size and (tmp_path / "out.json").exists()


def test_a_missing_script_is_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["animate", str(tmp_path / "no.toml"), "-o", str(tmp_path / "out.mkv")]) == 2
    assert "cannot read" in capsys.readouterr().err
