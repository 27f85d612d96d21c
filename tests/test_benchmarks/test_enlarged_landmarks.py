"""Landmarks of small pictures are those of the same face drawn large."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from studio import REST, Studio

from aam.annotation.landmark_files import read_landmark_csv
from aam.annotation.landmark_search import StillLandmarks
from benchmarks.enlarged_landmarks import main


def test_a_face_at_half_the_size_has_its_landmarks_and_a_wall_has_none(
    networks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    large = Studio().draw(REST)
    expected = StillLandmarks().find(large)
    assert expected is not None
    small = cv2.resize(large, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    folder, out = tmp_path / "small", tmp_path / "small.csv"
    folder.mkdir()
    cv2.imwrite(str(folder / "face.png"), small)
    cv2.imwrite(str(folder / "wall.png"), np.full((60, 60, 3), 128, np.uint8))
    main([str(folder), "-o", str(out)])
    ((name, found),) = read_landmark_csv(out).items()
    assert name == "small/face.png"
    distance = np.linalg.norm(2 * found + 0.5 - expected[:, :2], axis=1)
    assert np.median(distance) < 2
    assert "wall.png: no face" in capsys.readouterr().err
