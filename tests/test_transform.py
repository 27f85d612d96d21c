"""Components: equal harm, no correlation, the strongest first, and back again."""

import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.shape_free import ShapeFree
from encoder.appearance.template import Template
from encoder.appearance.texture import sample
from encoder.capture.colour import luma
from encoder.coding.transform import (
    LEAST_SPREAD,
    LID_HARM,
    combine,
    measure_spreads,
    project,
    sensitivity,
)
from encoder.fitting.analysis_by_synthesis import Refiner
from protocol.frames.frame_transform import GEOMETRY, face_from_components, vector_from_face
from protocol.frames.scalar_quantiser import pose_from_motion
from protocol.frames.temporal_prediction import KINDS, MAX_SPREAD, UNIT
from shared_model.appearance import atlas_of
from shared_model.parameters import EAU_INDEX, LID_EAUS, FaceParameters

MODES = (b"first", b"second")
D = GEOMETRY + len(MODES)


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
    matrix = combine(vectors(), harm(), MODES, 8).matrix
    gram = matrix @ harm() @ matrix.T
    # The basis travels as bytes.
    assert np.diag(gram) == pytest.approx(1, abs=0.05)
    assert np.abs(gram - np.diag(np.diag(gram))).max() < 0.1


def test_components_are_sorted_and_those_that_stand_still_left_out() -> None:
    components = combine(vectors(), harm(), MODES, 8)
    values = project(components, vectors(), harm())
    spread = values.std(0) + np.abs(values.mean(0))
    assert len(components.basis) < D
    assert (spread > 0.9 * LEAST_SPREAD).all()
    assert values.var(0)[:3].sum() > 0.5 * values.var(0).sum()
    still = combine(np.tile(vectors()[:1], (50, 1)), harm(), MODES, 8)
    assert len(still.basis) == 1


def test_what_is_projected_comes_back_but_for_what_is_left_out() -> None:
    y = vectors()
    components = combine(y, harm(), MODES, 8)
    back = components.centre + project(components, y, harm()) @ components.matrix
    error = np.einsum("td,de,te->t", y - back, harm(), y - back).mean()
    about_mean = np.einsum("td,de,te->t", y - y.mean(0), harm(), y - y.mean(0)).mean()
    assert error < LEAST_SPREAD**2 * D and error < 0.01 * about_mean


def test_a_face_survives_components(shots: Shots) -> None:
    reference = shots.faces[0].pose
    faces = [
        FaceParameters(face.pose, face.eau, np.array([3.0 * i, -2.0 * i]))
        for i, face in enumerate(shots.faces)
    ]
    y = np.array([vector_from_face(face, reference) for face in faces])
    components = combine(y, np.diag(np.full(D, 400.0)), MODES, 8)
    values = project(components, y, np.diag(np.full(D, 400.0)))
    for face, row in zip(faces, values, strict=True):
        coded = np.rint(row * UNIT).astype(np.int64)
        back = face_from_components(components, coded, reference)
        assert back.eau == pytest.approx(face.eau, abs=0.05)
        assert back.modes == pytest.approx(face.modes, abs=0.1)
        assert back.pose.translation_mm == pytest.approx(face.pose.translation_mm, abs=0.5)


def test_spreads_grow_with_motion_and_stay_in_range() -> None:
    rng = np.random.default_rng(3)
    calm = np.cumsum(rng.normal(size=(200, 4)), axis=0)
    spreads = measure_spreads(np.concatenate([calm, 16 * calm], axis=1), 8)
    assert spreads.shape == (8, KINDS) and spreads.max() <= MAX_SPREAD
    # Sixteen times as large: sixteen quarter octaves more.
    assert np.abs(spreads[4:].astype(int) - spreads[:4] - 16).max() <= 1
    # A frame between two known ones is predicted better the nearer they are.
    assert (spreads[:, KINDS - 1] < spreads[:, 1]).all()


@pytest.mark.parametrize("count", [1, 2, 8, 9, 10, 17])
def test_the_shortest_calls_have_components(count: int) -> None:
    y = vectors(count)
    components = combine(y, harm(), MODES, 8)
    assert np.isfinite(project(components, y, harm())).all()
    assert components.spreads.shape == (len(components.basis), KINDS)


@pytest.fixture(scope="module")
def refiner(shots: Shots) -> Refiner:
    shape = ShapeFree(shots.face, atlas_of(shots.face.head, 96), shots.camera)
    grey = sample(luma(shots.pictures[2]), shape.positions(shots.faces[2]))[:, 0]
    modes = np.full((1, len(shape)), 2.0, np.float32)
    return Refiner(
        shots.face.head, shots.face, shape, Template(grey, modes, np.ones(len(shape), np.float32))
    )


def test_harm_foretells_what_an_error_does_to_the_picture(shots: Shots, refiner: Refiner) -> None:
    face, reference = shots.faces[2], shots.faces[0].pose
    sensed = sensitivity(refiner, [whole(shots.pictures[2])], [face], reference)
    h = sensed.harm(refiner.template.modes)
    assert np.allclose(h, h.T) and (np.linalg.eigvalsh(h) > 0).all()
    grey, shape = luma(shots.pictures[2]), refiner.shape
    weight = refiner.seen(face).astype(float)
    before = sample(grey, shape.positions(face))[:, 0]
    y = vector_from_face(face, reference)[:GEOMETRY]
    for number, size in ((1, 0.5), (4, 1.0), (6 + EAU_INDEX["jaw_drop"], 0.05)):
        error = np.zeros(len(h))
        error[number] = size
        moved = y + error[:GEOMETRY]
        off = FaceParameters(pose_from_motion(moved[:6], reference), moved[6:])
        change = sample(grey, shape.positions(off))[:, 0] - before
        measured = float((weight * change**2).sum() / weight.sum())
        assert error @ h @ error == pytest.approx(measured, rel=0.4)
    # A mode of two grey levels a unit, all over the face.
    assert h[-1, -1] == pytest.approx(4, rel=0.01)


def test_lids_may_count_for_more_together_than_apart(refiner: Refiner, shots: Shots) -> None:
    sensed = sensitivity(refiner, [whole(shots.pictures[2])], [shots.faces[2]], shots.faces[0].pose)
    modes = refiner.template.modes
    more = sensed.harm(modes, LID_HARM + np.array([[10, 8], [8, 10]])) - sensed.harm(modes)
    both, wink = np.zeros((2, len(more)))
    lids = [6 + EAU_INDEX[name] for name in LID_EAUS]
    both[lids], wink[lids] = (1, 1), (1, -1)
    assert both @ more @ both == pytest.approx(36, rel=0.01)
    assert wink @ more @ wink == pytest.approx(4, rel=0.01)
    assert np.trace(more) == pytest.approx(20, rel=0.01)
