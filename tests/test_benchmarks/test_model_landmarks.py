"""Landmarks of a model against those of annotations: a distance, a face not found, no picture."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from aam.annotation.annotate import AnnotationOptions, annotate
from aam.annotation.annotation_file import read_annotations
from aam.annotation.landmark_search import ModelLandmarks
from aam.model_file import BUILTIN, named_model
from benchmarks.model_landmarks import distance_percent, main
from encoder.capture.video_source import open_source
from shared_model.errors import UserError


def test_a_model_is_measured_by_annotated_landmarks(
    carphone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, folder = tmp_path / "face.png", tmp_path / "annotated"
    with open_source(str(carphone)) as capture:
        cv2.imwrite(str(path), next(iter(capture))[1])
    folder.mkdir()
    annotate([path], folder, AnnotationOptions(landmarks=BUILTIN))
    main([str(folder), "--model", BUILTIN])
    row = capsys.readouterr().out.splitlines()[-1].split()
    assert row[:3] == ["annotated", BUILTIN, "1"] and [float(x) for x in row[3:]] == [0, 100, 100]
    (annotation,) = read_annotations(folder)
    model = ModelLandmarks(named_model(BUILTIN))
    cv2.imwrite(str(path), np.full((90, 90, 3), 80, np.uint8))
    assert distance_percent(model, annotation) == float("inf")
    path.unlink()
    with pytest.raises(UserError, match=r"face\.png"):
        distance_percent(model, annotation)
