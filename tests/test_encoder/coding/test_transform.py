"""The transform: unit distortion, no correlation, sorted by motion, invertible."""

import numpy as np
import pytest
from shots import Shots

from encoder.coding.transform import MIN_STD, design_transform, estimate_scales, project
from protocol.frames.frame_transform import GEOMETRY_SIZE, face_from_coefficients, vector_from_face
from protocol.frames.temporal_prediction import MAX_SCALE_CODE, PREDICTION_KINDS, STEPS_PER_UNIT
from shared_model.parameters import FaceParameters

MODES = (b"first", b"second")
D = GEOMETRY_SIZE + len(MODES)


def distortion(seed: int = 1) -> np.ndarray:
    """(d, d) a positive definite distortion matrix with correlated errors."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(60, D)) * np.geomspace(1, 30, D)
    return np.asarray(rows.T @ rows / 60)


def vectors(count: int = 240, seed: int = 2) -> np.ndarray:
    """(t, d) mixtures of five slow sources, with noise, about a mean."""
    rng = np.random.default_rng(seed)
    sources = np.zeros((count, 5))
    for t in range(1, count):
        sources[t] = 0.95 * sources[t - 1] + rng.normal(size=5)
    mixed = sources @ rng.normal(size=(5, D)) * 0.2 + rng.normal(size=(count, D)) * 0.003
    return np.asarray(mixed + np.linspace(-1, 1, D))


def test_a_unit_of_every_component_adds_equal_distortion() -> None:
    matrix = design_transform(vectors(), distortion(), MODES, 8).matrix
    gram = matrix @ distortion() @ matrix.T
    # The basis is quantised to bytes.
    assert np.diag(gram) == pytest.approx(1, abs=0.05)
    assert np.abs(gram - np.diag(np.diag(gram))).max() < 0.1


def test_components_are_sorted_and_constant_ones_are_not_sent() -> None:
    transform = design_transform(vectors(), distortion(), MODES, 8)
    values = project(transform, vectors(), distortion())
    size = values.std(0) + np.abs(values.mean(0))
    assert len(transform.basis) < D
    assert (size > 0.9 * MIN_STD).all()
    assert values.var(0)[:3].sum() > 0.5 * values.var(0).sum()
    motionless = design_transform(np.tile(vectors()[:1], (50, 1)), distortion(), MODES, 8)
    assert len(motionless.basis) == 1


def test_projection_is_inverted_up_to_the_omitted_components() -> None:
    y = vectors()
    transform = design_transform(y, distortion(), MODES, 8)
    decoded = transform.mean + project(transform, y, distortion()) @ transform.matrix
    error = np.einsum("td,de,te->t", y - decoded, distortion(), y - decoded).mean()
    about_mean = np.einsum("td,de,te->t", y - y.mean(0), distortion(), y - y.mean(0)).mean()
    assert error < MIN_STD**2 * D and error < 0.01 * about_mean


def test_a_face_is_recovered_from_its_coded_components(shots: Shots) -> None:
    reference = shots.faces[0].pose
    faces = [
        FaceParameters(face.pose, face.eau, np.array([3.0 * i, -2.0 * i]))
        for i, face in enumerate(shots.faces)
    ]
    y = np.array([vector_from_face(face, reference) for face in faces])
    transform = design_transform(y, np.diag(np.full(D, 400.0)), MODES, 8)
    values = project(transform, y, np.diag(np.full(D, 400.0)))
    for face, row in zip(faces, values, strict=True):
        coded = np.rint(row * STEPS_PER_UNIT).astype(np.int64)
        decoded = face_from_coefficients(transform, coded, reference)
        assert decoded.eau == pytest.approx(face.eau, abs=0.05)
        assert decoded.modes == pytest.approx(face.modes, abs=0.1)
        assert decoded.pose.translation_mm == pytest.approx(face.pose.translation_mm, abs=0.5)


def test_scale_codes_grow_with_motion_and_stay_in_range() -> None:
    rng = np.random.default_rng(3)
    slow = np.cumsum(rng.normal(size=(200, 4)), axis=0)
    scale_codes = estimate_scales(np.concatenate([slow, 16 * slow], axis=1), 8)
    assert scale_codes.shape == (8, PREDICTION_KINDS) and scale_codes.max() <= MAX_SCALE_CODE
    # Sixteen times as large: sixteen quarter octaves more.
    assert np.abs(scale_codes[4:].astype(int) - scale_codes[:4] - 16).max() <= 1
    # A frame between two known ones is predicted better the nearer they are.
    assert (scale_codes[:, PREDICTION_KINDS - 1] < scale_codes[:, 1]).all()


@pytest.mark.parametrize("count", [1, 2, 8, 9, 10, 17])
def test_the_shortest_calls_have_a_transform(count: int) -> None:
    y = vectors(count)
    transform = design_transform(y, distortion(), MODES, 8)
    assert np.isfinite(project(transform, y, distortion())).all()
    assert transform.scale_codes.shape == (len(transform.basis), PREDICTION_KINDS)
