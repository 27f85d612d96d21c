"""The transform of pose, EAUs and mode coefficients to decorrelated components (thesis eq. 2.18).

A Karhunen-Loeve transform in the metric of the distortion: the distortion matrix and the person's
motion are diagonalised together.  Equal quantiser steps then add equal distortion, and components
are uncorrelated, the one of largest motion first.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.coding.distortion import distortion_of, with_layers
from encoder.learning.person_model import TrainedModel
from protocol.frames.frame_transform import (
    GEOMETRY_SIZE,
    MAX_BASIS_CODE,
    MAX_MEAN_CODE,
    MEAN_STEPS_PER_UNIT,
    SCALE_CODE_STEP,
    FrameTransform,
    codes_from_units,
    units_from_codes,
    vector_from_face,
)
from protocol.frames.temporal_prediction import (
    ANCHOR,
    MAX_SCALE_CODE,
    PREDICTION_KINDS,
    STEPS_PER_UNIT,
    coding_order,
    interpolate,
)
from shared_model.arrays import Array, Integers, Picture
from shared_model.parameters import FaceParameters

# The motion of y is its difference over so many frames, plus its variance with this weight.
INNOVATION_LAG = 4
VARIANCE_WEIGHT = 1.0
# A component is sent if standard deviation plus mean of its magnitude exceed this, units.
MIN_STD = 0.2
# The largest code of a basis row, by the standard deviation of its component, and its minimum.
BASIS_CODES_PER_STD, MIN_BASIS_CODE = 9.0, 22.0


@dataclass(frozen=True, slots=True)
class WhitenedSpace:
    """The metric space in which errors of length 1 add a unit of distortion in any direction.

    A vector y (d,) is (y - mean) @ root in this space.
    unit_codes, mean_codes: see `FrameTransform`.
    root: (d, d) Cholesky factor, root @ root.T is the distortion matrix.
    """

    unit_codes: Picture
    mean_codes: Integers
    root: Array

    @classmethod
    def from_distortion(cls, mean: Array, distortion: Array) -> "WhitenedSpace":
        """The space of a distortion matrix (d, d) about a mean (d,)."""
        unit_codes = codes_from_units(1 / np.sqrt(np.diag(distortion)))
        steps = np.rint(MEAN_STEPS_PER_UNIT * mean / units_from_codes(unit_codes))
        mean_codes = np.clip(steps, -MAX_MEAN_CODE, MAX_MEAN_CODE).astype(np.int64)
        return cls(unit_codes, mean_codes, np.asarray(np.linalg.cholesky(distortion)))

    def whiten(self, vectors: Array) -> Array:
        """Vectors y (t, d) in this space."""
        mean = self.mean_codes * units_from_codes(self.unit_codes) / MEAN_STEPS_PER_UNIT
        return np.asarray((vectors - mean) @ self.root)

    def frame_transform(self, modes: tuple[bytes, ...], axes: Array, std: Array) -> FrameTransform:
        """The transform to components along orthonormal axes (d, n) of this space, scale codes 0.

        std: (n,) standard deviation of each component, units.
        """
        rows = np.linalg.solve(self.root.T, axes).T / units_from_codes(self.unit_codes)
        # The rounding error of a basis row is multiplied by the values of its component.
        largest_code = np.clip(BASIS_CODES_PER_STD * std, MIN_BASIS_CODE, MAX_BASIS_CODE)
        exponents = np.ceil(np.log2(np.abs(rows).max(1) * MAX_BASIS_CODE / largest_code)).astype(
            np.int8
        )
        basis = np.ldexp(rows, -exponents.astype(int)[:, None]) * MAX_BASIS_CODE
        no_scales = np.zeros((len(rows), PREDICTION_KINDS), dtype=np.uint8)
        return FrameTransform(
            modes,
            self.unit_codes,
            self.mean_codes,
            np.rint(basis).astype(np.int8),
            exponents,
            no_scales,
            layers=len(self.mean_codes) - GEOMETRY_SIZE - len(modes),
        )


def design_transform(
    vectors: Array, distortion: Array, modes: tuple[bytes, ...], frames_per_packet: int
) -> FrameTransform:
    """The transform of one call.

    vectors: (t, d) y of all frames.  distortion: (d, d), see `DistortionModel`.
    """
    space = WhitenedSpace.from_distortion(vectors.mean(0), distortion)
    white = space.whiten(vectors)
    motion = np.diff(white[::INNOVATION_LAG], axis=0) if len(white) > 2 * INNOVATION_LAG else white
    axes = principal_axes(
        motion.T @ motion / max(len(motion), 1) + VARIANCE_WEIGHT * (white.T @ white) / len(white)
    )
    values = white @ axes
    sent = np.abs(values).std(0) + np.abs(values.mean(0)) > MIN_STD
    sent[0] = True
    transform = space.frame_transform(modes, axes[:, sent], values[:, sent].std(0))
    scales = estimate_scales(project(transform, vectors, distortion), frames_per_packet)
    return replace(transform, scale_codes=scales)


def principal_axes(power: Array) -> Array:
    """The eigenvectors (d, d) of a symmetric matrix as columns, by descending eigenvalue."""
    _, axes = np.linalg.eigh(power)
    return np.asarray(axes[:, ::-1])


def project(transform: FrameTransform, vectors: Array, distortion: Array) -> Array:
    """Component values (t, n), units, of least distortion for vectors y (t, d)."""
    matrix = transform.matrix
    normal = matrix @ distortion @ matrix.T
    return np.asarray(np.linalg.solve(normal, matrix @ distortion @ (vectors - transform.mean).T).T)


def estimate_scales(values: Array, frames_per_packet: int) -> Picture:
    """Scale codes (n, PREDICTION_KINDS) of the prediction errors of component values (t, n).

    A prediction kind without frames has the scales of the kind before.
    """
    errors: list[list[Array]] = [[] for _ in range(PREDICTION_KINDS)]
    errors[0].append(np.abs(values))
    steps = np.rint(values * STEPS_PER_UNIT).astype(np.int64)
    for start in range(0, len(steps) - frames_per_packet, frames_per_packet):
        for kind, error in prediction_errors(steps[start : start + frames_per_packet + 1]):
            errors[kind].append(np.abs(error)[None] / STEPS_PER_UNIT)
    mean_sizes = np.empty((values.shape[1], PREDICTION_KINDS))
    for kind in range(PREDICTION_KINDS):
        errors[kind] = errors[kind] or errors[kind - 1]
        mean_sizes[:, kind] = np.concatenate(errors[kind]).mean(0)
    return scale_codes(mean_sizes)


def prediction_errors(frames: Integers) -> Iterator[tuple[int, Integers]]:
    """The prediction kind and error (n,) of each frame of a packet, in coding order, undamped.

    frames: (count + 1, n), the anchor of the packet before first.
    """
    known = {0: frames[0]}
    for coded in coding_order(len(frames) - 1):
        predicted = known[0] if coded.kind == ANCHOR else interpolate(coded, known)
        known[coded.index] = frames[coded.index]
        yield coded.kind, frames[coded.index] - predicted


def scale_codes(mean_sizes: Array) -> Picture:
    """Scale codes (n, PREDICTION_KINDS) of mean absolute values, units."""
    octaves = np.log2(np.maximum(mean_sizes, 1e-6) * 16)
    codes = SCALE_CODE_STEP * np.rint(4 / SCALE_CODE_STEP * octaves)
    return np.asarray(np.clip(codes, 0, MAX_SCALE_CODE - 1), np.uint8)


def transform_call(
    trained: TrainedModel,
    faces: Sequence[FaceParameters],
    frames_per_packet: int,
    layers: Array | None = None,
) -> tuple[FrameTransform, Array]:
    """The transform of a call, and the component values (t, n) of all its faces.

    layers: the distortion of their layer coefficients, see `with_layers`; None: they have none.
    """
    person = trained.person
    distortion = distortion_of(trained).distortion_matrix(person.texel_fitter.template.modes)
    if layers is not None:
        distortion = with_layers(distortion, layers)
    vectors = np.array([vector_from_face(face, person.reference.pose) for face in faces])
    modes = person.appearance.modes
    transform = design_transform(vectors, distortion, modes, frames_per_packet)
    return transform, project(transform, vectors, distortion)
