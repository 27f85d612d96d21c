"""Annotation: known faces are found again; files; what is done is not done again."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from aam_faces import HEAD, POSE, SIZE, known_face, landmarks_of, write_csv, write_picture

from aam.annotation.annotate import annotation_names, list_images
from aam.annotation.annotation_file import read_annotation
from aam.annotation.landmark_files import read_landmark_file
from aam.annotation.landmark_schemes import IBUG_68, from_given, from_search
from aam.annotation.still_fit import fit_still
from aam.shape_space import SHAPE_NAMES, actuators, shape_vector
from risorius.cli import main
from shared_model.errors import UserError


def test_a_known_face_is_found_again_within_2_percent_of_range_and_1_degree() -> None:
    aau, eau = known_face()
    fitted = fit_still(HEAD, SIZE, from_search(landmarks_of(aau, eau, POSE)))
    # The priors pull towards the mean.
    assert fitted.error < 0.002
    assert np.abs(fitted.aau - aau).max() < 0.15
    assert np.abs(fitted.face.eau - eau).max() < 0.1
    assert np.degrees(np.abs(fitted.pose[:3] - POSE[:3])).max() < 1
    assert np.abs(fitted.pose[3:5] - POSE[3:5]).max() < 1


def test_the_landmarks_of_a_scheme_tell_the_pose_too() -> None:
    aau, eau = known_face()
    points = landmarks_of(aau, eau, POSE)[list(IBUG_68), :2]
    fitted = fit_still(HEAD, SIZE, from_given(points))
    assert np.degrees(np.abs(fitted.pose[:3] - POSE[:3])).max() < 3


def test_full_perspective_explains_landmarks_of_a_far_face_as_well() -> None:
    aau, eau = known_face()
    small = POSE.copy()
    small[5] = np.log(0.2)
    found = fit_still(HEAD, SIZE, from_search(landmarks_of(aau, eau, small)), "perspective")
    assert found.error < 0.02
    assert found.camera.focal_px == pytest.approx(1.3 * 220)


def test_a_number_of_landmarks_that_no_scheme_has_is_refused() -> None:
    with pytest.raises(ValueError, match="5 landmarks, expected 68, 73, 468"):
        from_given(np.zeros((5, 2)))


def test_actuators_and_shape_vector_are_inverse_within_their_ranges() -> None:
    aau, eau = known_face()
    for found, expected in zip(actuators(shape_vector(aau, eau)), (aau, eau), strict=True):
        np.testing.assert_allclose(found, expected)


def test_names_take_as_many_folders_as_tell_pictures_apart() -> None:
    paths = [Path("a/s1/1.pgm"), Path("a/s2/1.pgm")]
    assert annotation_names(paths) == ["s1_1", "s2_1"]


def test_landmark_files_of_both_formats(tmp_path: Path) -> None:
    asf = tmp_path / "a.asf"
    asf.write_text("# comment\n2\n0 0 0.25 0.5 0 1 1 0 0 0\n0 0 0.5 0.75 1 0 0 0 0 0\na.jpg\n")
    np.testing.assert_allclose(
        read_landmark_file(asf, (100, 40)), np.array([[24.5, 19.5], [49.5, 29.5]])
    )
    pts = tmp_path / "a.pts"
    pts.write_text("version: 1\nn_points: 2\n{\n1.5 2\n3 4\n}\n")
    np.testing.assert_allclose(read_landmark_file(pts, (9, 9)), np.array([[1.5, 2.0], [3.0, 4.0]]))
    pts.write_text("{ 1 two }")
    with pytest.raises(UserError, match=r"a\.pts: could not convert"):
        read_landmark_file(pts, (9, 9))


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Two pictures of different people, their landmarks in a CSV, and one without a line there."""
    folder = tmp_path / "in"
    folder.mkdir()
    points = landmarks_of(*known_face(), POSE)
    points = np.nan_to_num(points)
    for number, name in enumerate(("p1_a.png", "p2_a.png", "p2_b.png")):
        write_picture(folder / name, number)
    write_csv(tmp_path / "given.csv", {"p1_a.png": points, "p2_a.png": points})
    return folder


def run_annotate(pictures: Path) -> tuple[int, Path]:
    out, given = pictures.parent / "out", pictures.parent / "given.csv"
    arguments = [str(pictures), "-o", str(out), "--landmarks", str(given), "-q"]
    return main(["annotate", *arguments, "--person", "(p[0-9])_"]), out


def test_annotate_writes_open_files_and_tells_of_a_picture_without_landmarks(
    pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out = run_annotate(pictures)
    told = capsys.readouterr().err
    assert code == 2 and "p2_b.png" in told and "has no line for it" in told
    assert "2 annotated, 0 were so before" in told
    values = json.loads((out / "p1_a.json").read_text())
    assert values["person"] == "p1" and set(values["shape"]) == set(SHAPE_NAMES)
    read = read_annotation(out / "p1_a.json")
    assert read.texture.shape == (256, 256, 3) and np.abs(read.shape).max() <= 1
    assert values["pose"]["scale"] == pytest.approx(POSE[5], abs=0.02)
    sheet = cv2.imread(str(out / "contact_000.jpg"))
    assert sheet is not None and sheet.shape == (160, 6 * 320, 3)


def test_annotate_passes_over_what_is_there_and_repeats_what_is_damaged(
    pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_annotate(pictures)
    _, out = run_annotate(pictures)
    assert "0 annotated, 2 were so before" in capsys.readouterr().err
    (out / "p1_a.json").write_text("{")
    write_picture(pictures / "p2_a.png", seed=9)
    run_annotate(pictures)
    assert "2 annotated, 0 were so before" in capsys.readouterr().err


def test_annotate_without_any_result_ends_with_2_for_what_was_given(
    pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = str(pictures / "p2_b.png")
    given = str(pictures.parent / "given.csv")
    out = str(pictures.parent / "none")
    assert main(["annotate", alone, "-o", out, "--landmarks", given, "-q"]) == 2
    assert "none of 1 pictures was annotated" in capsys.readouterr().err


def test_annotate_ends_with_3_where_a_picture_shows_no_face(networks: Path, tmp_path: Path) -> None:
    picture, text = tmp_path / "grey.png", tmp_path / "text.jpg"
    cv2.imwrite(str(picture), np.full((64, 64, 3), 128, np.uint8))
    text.write_text("no picture")
    for path, code in ((picture, 3), (text, 2)):
        assert main(["annotate", str(path), "-o", str(tmp_path / "out"), "-q"]) == code


def test_a_damaged_annotation_is_one_line(pictures: Path) -> None:
    _, out = run_annotate(pictures)
    path = out / "p1_a.json"
    values = json.loads(path.read_text())
    for damaged in ({"focal_px": None}, {"focal_px": "far"}, {"person": ...}):
        broken = {name: damaged.get(name, value) for name, value in values.items()}
        left = {name: value for name, value in broken.items() if value is not ...}
        path.write_text(json.dumps(left))
        with pytest.raises(UserError, match=r"p1_a\.json: .*annotate the picture again"):
            read_annotation(path)
    path.write_text(json.dumps(values))
    arrays = path.with_suffix(".npz")
    data = bytearray(arrays.read_bytes())
    # In the compressed data of the first array, behind its header.
    data[200:260] = bytes(60)
    arrays.write_bytes(data)
    with pytest.raises(UserError, match="damaged"):
        read_annotation(path)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs /proc/self/mem")
def test_a_picture_that_cannot_be_read_any_more_is_noted_and_the_others_go_on(
    pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_annotate(pictures)
    (pictures / "p1_a.png").unlink()
    (pictures / "p1_a.png").symlink_to("/proc/self/mem")
    code, _ = run_annotate(pictures)
    told = capsys.readouterr().err
    assert code == 2 and "p1_a.png" in told and "0 annotated, 1 were so before" in told


def test_contact_sheets_are_no_pictures_to_annotate(tmp_path: Path) -> None:
    sheet, picture = tmp_path / "contact_000.jpg", tmp_path / "a.jpg"
    sheet.touch()
    with pytest.raises(UserError, match="holds no pictures"):
        list_images([tmp_path])
    picture.touch()
    assert list_images([tmp_path]) == [picture]
    assert list_images([sheet]) == [sheet]
