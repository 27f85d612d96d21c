"""Components: equal harm, no correlation, the strongest first, and back again."""

import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.capture.colour import luma_f32
from encoder.coding.distortion import EYELID_DISTORTION, measure_distortion
from encoder.coding.transform import MIN_STD, design_transform, estimate_scales, project
from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.runtime.image_ops import sample_bicubic
from protocol.frames.frame_transform import GEOMETRY_SIZE, face_from_coefficients, vector_from_face
from protocol.frames.scalar_quantiser import pose_from_motion
from protocol.frames.temporal_prediction import MAX_SCALE_CODE, PREDICTION_KINDS, STEPS_PER_UNIT
from shared_model.appearance import atlas_of
from shared_model.parameters import EAU_INDEX, LID_EAUS, FaceParameters

MODES = (b"first", b"second")
D = GEOMETRY_SIZE + len(MODES)


def harm(seed: int = 1) -> np.ndarray:
    """(d, d) symmetric, positive, with errors that hide one another."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(60, D)) * np.geomspace(1, 30, D)
    return np.asarray(rows.T @ rows / 60)


def vectors(count: int = 240, seed: int = 2) -> np.ndarray:
    """(t, d) of a few slow sources and a little noise about a mean."""
    rng = np.random.default_rng(seed)
    sources = np.zeros((count, 5))
    for t in range(1, count):
        sources[t] = 0.95 * sources[t - 1] + rng.normal(size=5)
    mixed = sources @ rng.normal(size=(5, D)) * 0.2 + rng.normal(size=(count, D)) * 0.003
    return np.asarray(mixed + np.linspace(-1, 1, D))


def test_a_unit_of_every_component_does_equal_harm() -> None:
    matrix = design_transform(vectors(), harm(), MODES, 8).matrix
    gram = matrix @ harm() @ matrix.T
    # The basis travels as bytes.
    assert np.diag(gram) == pytest.approx(1, abs=0.05)
    assert np.abs(gram - np.diag(np.diag(gram))).max() < 0.1


def test_components_are_sorted_and_those_that_stand_still_left_out() -> None:
    components = design_transform(vectors(), harm(), MODES, 8)
    values = project(components, vectors(), harm())
    spread = values.std(0) + np.abs(values.mean(0))
    assert len(components.basis) < D
    assert (spread > 0.9 * MIN_STD).all()
    assert values.var(0)[:3].sum() > 0.5 * values.var(0).sum()
    still = design_transform(np.tile(vectors()[:1], (50, 1)), harm(), MODES, 8)
    assert len(still.basis) == 1


def test_what_is_projected_comes_back_but_for_what_is_left_out() -> None:
    y = vectors()
    components = design_transform(y, harm(), MODES, 8)
    back = components.mean + project(components, y, harm()) @ components.matrix
    error = np.einsum("td,de,te->t", y - back, harm(), y - back).mean()
    about_mean = np.einsum("td,de,te->t", y - y.mean(0), harm(), y - y.mean(0)).mean()
    assert error < MIN_STD**2 * D and error < 0.01 * about_mean


def test_a_face_survives_components(shots: Shots) -> None:
    reference = shots.faces[0].pose
    faces = [
        FaceParameters(face.pose, face.eau, np.array([3.0 * i, -2.0 * i]))
        for i, face in enumerate(shots.faces)
    ]
    y = np.array([vector_from_face(face, reference) for face in faces])
    components = design_transform(y, np.diag(np.full(D, 400.0)), MODES, 8)
    values = project(components, y, np.diag(np.full(D, 400.0)))
    for face, row in zip(faces, values, strict=True):
        coded = np.rint(row * STEPS_PER_UNIT).astype(np.int64)
        back = face_from_coefficients(components, coded, reference)
        assert back.eau == pytest.approx(face.eau, abs=0.05)
        assert back.modes == pytest.approx(face.modes, abs=0.1)
        assert back.pose.translation_mm == pytest.approx(face.pose.translation_mm, abs=0.5)


def test_spreads_grow_with_motion_and_stay_in_range() -> None:
    rng = np.random.default_rng(3)
    calm = np.cumsum(rng.normal(size=(200, 4)), axis=0)
    spreads = estimate_scales(np.concatenate([calm, 16 * calm], axis=1), 8)
    assert spreads.shape == (8, PREDICTION_KINDS) and spreads.max() <= MAX_SCALE_CODE
    # Sixteen times as large: sixteen quarter octaves more.
    assert np.abs(spreads[4:].astype(int) - spreads[:4] - 16).max() <= 1
    # A frame between two known ones is predicted better the nearer they are.
    assert (spreads[:, PREDICTION_KINDS - 1] < spreads[:, 1]).all()


@pytest.mark.parametrize("count", [1, 2, 8, 9, 10, 17])
def test_the_shortest_calls_have_components(count: int) -> None:
    y = vectors(count)
    components = design_transform(y, harm(), MODES, 8)
    assert np.isfinite(project(components, y, harm())).all()
    assert components.scale_codes.shape == (len(components.basis), PREDICTION_KINDS)


@pytest.fixture(scope="module")
def refiner(shots: Shots) -> TexelFitter:
    shape = ShapeFreeFrame(shots.face, atlas_of(shots.face.head, 96), shots.camera)
    grey = sample_bicubic(luma_f32(shots.pictures[2]), shape.positions(shots.faces[2]))[:, 0]
    modes = np.full((1, len(shape)), 2.0, np.float32)
    return TexelFitter(
        shots.face.head, shots.face, shape, Template(grey, modes, np.ones(len(shape), np.float32))
    )


def test_harm_foretells_what_an_error_does_to_the_picture(
    shots: Shots, refiner: TexelFitter
) -> None:
    face, reference = shots.faces[2], shots.faces[0].pose
    sensed = measure_distortion(refiner, [whole(shots.pictures[2])], [face], reference)
    h = sensed.distortion_matrix(refiner.template.modes)
    assert np.allclose(h, h.T) and (np.linalg.eigvalsh(h) > 0).all()
    grey, shape = luma_f32(shots.pictures[2]), refiner.shape
    weight = refiner.visible(face).astype(float)
    before = sample_bicubic(grey, shape.positions(face))[:, 0]
    y = vector_from_face(face, reference)[:GEOMETRY_SIZE]
    for number, size in ((1, 0.5), (4, 1.0), (6 + EAU_INDEX["jaw_drop"], 0.05)):
        error = np.zeros(len(h))
        error[number] = size
        moved = y + error[:GEOMETRY_SIZE]
        off = FaceParameters(pose_from_motion(moved[:6], reference), moved[6:])
        change = sample_bicubic(grey, shape.positions(off))[:, 0] - before
        measured = float((weight * change**2).sum() / weight.sum())
        assert error @ h @ error == pytest.approx(measured, rel=0.4)
    # A mode of two grey levels a unit, all over the face.
    assert h[-1, -1] == pytest.approx(4, rel=0.01)


def test_lids_may_count_for_more_together_than_apart(refiner: TexelFitter, shots: Shots) -> None:
    sensed = measure_distortion(
        refiner, [whole(shots.pictures[2])], [shots.faces[2]], shots.faces[0].pose
    )
    modes = refiner.template.modes
    more = sensed.distortion_matrix(
        modes, EYELID_DISTORTION + np.array([[10, 8], [8, 10]])
    ) - sensed.distortion_matrix(modes)
    both, wink = np.zeros((2, len(more)))
    lids = [6 + EAU_INDEX[name] for name in LID_EAUS]
    both[lids], wink[lids] = (1, 1), (1, -1)
    assert both @ more @ both == pytest.approx(36, rel=0.01)
    assert wink @ more @ wink == pytest.approx(4, rel=0.01)
    assert np.trace(more) == pytest.approx(20, rel=0.01)
