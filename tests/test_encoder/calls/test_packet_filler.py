"""Frames whose layers are not fitted move between those whose layers are."""

from dataclasses import replace

import numpy as np
import pytest

from encoder.calls.frame_packets import PacketFiller
from encoder.capture.face_crop import crop_face
from encoder.learning.face_sample import FaceSample
from shared_model.geometry import pose_from_euler
from shared_model.parameters import FaceParameters

REST = FaceParameters(pose_from_euler(0, 0, 0, np.array([0.0, 0.0, 900.0])))
PICTURE = np.zeros((48, 64, 3), np.uint8)
POINTS = np.linspace(10, 40, 3 * 468).reshape(468, 3)


def add(filler: PacketFiller, layers: list[float], is_fitted: bool = True) -> None:
    """Add a frame with these coefficients; if they are not fitted, they are of the one before."""
    sample = FaceSample(crop_face(PICTURE, POINTS, 1.0), POINTS)
    coarse = PICTURE if is_fitted else None
    filler.add(replace(REST, layers=np.array(layers)), replace(sample, coarse=coarse))


@pytest.mark.parametrize("held", [1, 2])
def test_layers_that_are_not_fitted_are_between_those_that_are(held: int) -> None:
    filler = PacketFiller(1)
    add(filler, [1.0, 6.0])
    for _ in range(held):
        add(filler, [1.0, 6.0], is_fitted=False)
    add(filler, [4.0, 0.0])
    drawn = [face.layers for face in filler.take(9).faces]
    expected = np.linspace([1.0, 6.0], [4.0, 0.0], held + 2)
    np.testing.assert_allclose(drawn, expected)


def test_they_stay_where_nothing_is_fitted_after_them() -> None:
    filler = PacketFiller(1)
    add(filler, [2.0])
    add(filler, [2.0], is_fitted=False)
    assert [face.layers.tolist() for face in filler.take(9).faces] == [[2.0], [2.0]]


def test_those_of_another_version_are_not_mixed() -> None:
    filler = PacketFiller(1)
    add(filler, [2.0], is_fitted=False)
    add(filler, [5.0, 5.0])
    assert filler.take(9).faces[0].layers.tolist() == [2.0]
