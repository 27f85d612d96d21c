"""The distortion model predicts what parameter errors do to the picture."""

import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.capture.colour import luma_f32
from encoder.coding.distortion import EYELID_DISTORTION, measure_distortion
from encoder.fitting.analysis_by_synthesis import TexelFitter
from protocol.frames.frame_transform import GEOMETRY_SIZE, vector_from_face
from protocol.frames.scalar_quantiser import pose_from_motion
from runtime.image_ops import sample_bicubic
from shared_model.appearance import atlas_of
from shared_model.parameters import EAU_INDEX, LID_EAUS, FaceParameters


@pytest.fixture(scope="module")
def fitter(shots: Shots) -> TexelFitter:
    shape = ShapeFreeFrame(shots.face, atlas_of(shots.face.head, 96), shots.camera)
    luma = sample_bicubic(luma_f32(shots.pictures[2]), shape.positions(shots.faces[2]))[:, 0]
    modes = np.full((1, len(shape)), 2.0, np.float32)
    return TexelFitter(shots.face, shape, Template(luma, modes, np.ones(len(shape), np.float32)))


def test_the_distortion_matrix_predicts_the_squared_error_of_a_parameter_error(
    shots: Shots, fitter: TexelFitter
) -> None:
    face, reference = shots.faces[2], shots.faces[0].pose
    model = measure_distortion(fitter, [whole(shots.pictures[2])], [face], reference)
    matrix = model.distortion_matrix(fitter.template.modes)
    assert np.allclose(matrix, matrix.T) and (np.linalg.eigvalsh(matrix) > 0).all()
    luma, shape = luma_f32(shots.pictures[2]), fitter.shape
    weight = fitter.visible(face).astype(float)
    before = sample_bicubic(luma, shape.positions(face))[:, 0]
    y = vector_from_face(face, reference)[:GEOMETRY_SIZE]
    for number, size in ((1, 0.5), (4, 1.0), (6 + EAU_INDEX["jaw_drop"], 0.05)):
        error = np.zeros(len(matrix))
        error[number] = size
        moved = y + error[:GEOMETRY_SIZE]
        shifted = FaceParameters(pose_from_motion(moved[:6], reference), moved[6:])
        change = sample_bicubic(luma, shape.positions(shifted))[:, 0] - before
        measured = float((weight * change**2).sum() / weight.sum())
        assert error @ matrix @ error == pytest.approx(measured, rel=0.4)
    # A mode of two grey levels per unit at all texels.
    assert matrix[-1, -1] == pytest.approx(4, rel=0.01)


def test_a_common_error_of_both_eyelids_may_weigh_more_than_an_opposite_one(
    fitter: TexelFitter, shots: Shots
) -> None:
    model = measure_distortion(
        fitter, [whole(shots.pictures[2])], [shots.faces[2]], shots.faces[0].pose
    )
    modes = fitter.template.modes
    added = model.distortion_matrix(
        modes, EYELID_DISTORTION + np.array([[10, 8], [8, 10]])
    ) - model.distortion_matrix(modes)
    both, opposite = np.zeros((2, len(added)))
    eyelids = [6 + EAU_INDEX[name] for name in LID_EAUS]
    both[eyelids], opposite[eyelids] = (1, 1), (1, -1)
    assert both @ added @ both == pytest.approx(36, rel=0.01)
    assert opposite @ added @ opposite == pytest.approx(4, rel=0.01)
    assert np.trace(added) == pytest.approx(20, rel=0.01)
