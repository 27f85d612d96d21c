"""Combined components (thesis eq. 2.18): pose, actuators and coefficients as the values sent.

Two measures are diagonalised together: the harm that an error does to the picture (the
Gauss-Newton Hessian of the shape-free residual), which becomes the unit matrix, and the caller's
own motion, which becomes diagonal with the strongest first.  Equal steps then do equal harm, and
values are uncorrelated.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFree
from encoder.appearance.texture import sample
from encoder.capture.colour import luma
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import Refiner
from protocol.frames.frame_transform import (
    CENTRE_STEPS,
    GEOMETRY,
    MAX_BASIS,
    MAX_CENTRE,
    SPREAD_STEP,
    Components,
    codes_of_units,
    unit_of,
    vector_from_face,
)
from protocol.frames.scalar_quantiser import pose_from_motion
from protocol.frames.temporal_prediction import (
    ANCHOR,
    KINDS,
    MAX_SPREAD,
    UNIT,
    Integers,
    coding_order,
    interpolate,
)
from shared_model.parameters import EAUS, LIDS, FaceParameters, Pose, clip_eau

Array = NDArray[np.float64]

# Steps of the numeric derivatives: degrees, mm, log depth, actuators.
_PROBE = np.array([0.2, 0.2, 0.2, 0.4, 0.4, 0.002, *[0.03] * (GEOMETRY - 6)])
# Frames over which motion is measured, and how much plain variance counts beside it.
MOTION_FRAMES = 4
VARIANCE_SHARE = 1.0
# A component is not sent if its size varies by less than this and so does its mean, units.
LEAST_SPREAD = 0.2
# Steps of a basis row to the usual size of its component, and the least that a row has.
BASIS_STEPS, LEAST_REACH = 9.0, 22.0
# An actuator's error is seen by people even where it costs little PSNR: harm per unit, grey^2.  A
# blink is over after two or three frames, and small.  That of lids is (2, 2), left and right.
EAU_HARM, LID_HARM = 4.0, 40.0 * np.eye(len(LIDS))
_LIDS = [6 + index for index in LIDS]
_OTHERS = [6 + index for index in range(len(EAUS)) if index not in LIDS]


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What an error of y does to a caller's picture, whatever the modes.

    weight: (k,) of each texel, adding up to 1, mean of some frames.
    slope: (k, GEOMETRY) mean of weight times grey levels per unit of each geometric value.
    geometry: (GEOMETRY, GEOMETRY) mean squared grey error per squared unit.
    """

    weight: Array
    slope: Array
    geometry: Array

    def harm(self, modes: NDArray[np.float32], lid_harm: Array = LID_HARM) -> Array:
        """(d, d) mean squared grey error per squared unit of y; modes (m, k), luma.

        lid_harm: (2, 2) what errors of the lids do beside, to people.
        """
        cross = -self.slope.T @ modes.T
        among = (modes * self.weight) @ modes.T
        harm = np.block([[self.geometry, cross], [cross.T, among]])
        harm[_OTHERS, _OTHERS] += EAU_HARM
        harm[np.ix_(_LIDS, _LIDS)] += lid_harm
        harm[np.diag_indices(len(harm))] *= 1 + 1e-5
        return np.asarray(harm, np.float64)


def sensitivity(
    refiner: Refiner, crops: Sequence[Crop], faces: Sequence[FaceParameters], reference: Pose
) -> Sensitivity:
    """Measured at some frames.  reference: see `vector_from_face`."""
    count = len(refiner.shape)
    total = Sensitivity(
        np.zeros(count), np.zeros((count, GEOMETRY)), np.zeros((GEOMETRY, GEOMETRY))
    )
    for crop, face in zip(crops, faces, strict=True):
        rows = _luma_motion(refiner.shape, crop, face, reference).astype(np.float64)
        weight = refiner.template.weight * refiner.seen(face)
        share = weight.astype(np.float64) / weight.sum() / len(crops)
        slope = rows * share[:, None]
        total.weight[:] += share
        total.slope[:] += slope
        total.geometry[:] += slope.T @ rows
    return total


@dataclass(frozen=True, slots=True)
class HarmSpace:
    """Where an error of length 1 does a unit of harm, whatever its direction.

    A vector y (d,) is (y - centre) @ root there.

    units, centres: see `Components`.  root: (d, d), root @ root.T is the harm.
    """

    units: NDArray[np.uint8]
    centres: Integers
    root: Array

    @classmethod
    def about(cls, mean: Array, harm: Array) -> "HarmSpace":
        """Space about a mean (d,), by harm (d, d), see `Sensitivity.harm`."""
        units = codes_of_units(1 / np.sqrt(np.diag(harm)))
        steps = np.rint(CENTRE_STEPS * mean / unit_of(units))
        centres = np.clip(steps, -MAX_CENTRE, MAX_CENTRE).astype(np.int64)
        return cls(units, centres, np.asarray(np.linalg.cholesky(harm)))

    def white(self, vectors: Array) -> Array:
        """(t, d) y of some frames in this space."""
        centre = self.centres * unit_of(self.units) / CENTRE_STEPS
        return np.asarray((vectors - centre) @ self.root)

    def components(self, modes: tuple[bytes, ...], axes: Array, usual: Array) -> Components:
        """Components along orthonormal axes (d, n) of this space, all spreads 0.

        usual: (n,) standard deviation of each, units.
        """
        rows = np.linalg.solve(self.root.T, axes).T / unit_of(self.units)
        # What a row's rounding leaks into its neighbours grows with how far the component goes.
        reach = np.clip(BASIS_STEPS * usual, LEAST_REACH, MAX_BASIS)
        exponents = np.ceil(np.log2(np.abs(rows).max(1) * MAX_BASIS / reach)).astype(np.int8)
        basis = np.ldexp(rows, -exponents.astype(int)[:, None]) * MAX_BASIS
        flat = np.zeros((len(rows), KINDS), dtype=np.uint8)
        return Components(
            modes, self.units, self.centres, np.rint(basis).astype(np.int8), exponents, flat
        )


def combine(
    vectors: Array, harm: Array, modes: tuple[bytes, ...], frames_per_packet: int
) -> Components:
    """The components of one caller's call.

    vectors: (t, d) y of the frames.  harm: (d, d), see `Sensitivity.harm`.
    """
    space = HarmSpace.about(vectors.mean(0), harm)
    white = space.white(vectors)
    moves = np.diff(white[::MOTION_FRAMES], axis=0) if len(white) > 2 * MOTION_FRAMES else white
    axes = principal_axes(
        moves.T @ moves / max(len(moves), 1) + VARIANCE_SHARE * (white.T @ white) / len(white)
    )
    along = white @ axes
    kept = np.abs(along).std(0) + np.abs(along.mean(0)) > LEAST_SPREAD
    kept[0] = True
    draft = space.components(modes, axes[:, kept], along[:, kept].std(0))
    return replace(draft, spreads=measure_spreads(project(draft, vectors, harm), frames_per_packet))


def principal_axes(power: Array) -> Array:
    """(d, d) the eigenvectors of a symmetric matrix as columns, the strongest first."""
    _, axes = np.linalg.eigh(power)
    return np.asarray(axes[:, ::-1])


def project(components: Components, vectors: Array, harm: Array) -> Array:
    """(t, n) component values of y (t, d), in units: least harm by the rounded basis."""
    matrix = components.matrix
    normal = matrix @ harm @ matrix.T
    return np.asarray(np.linalg.solve(normal, matrix @ harm @ (vectors - components.centre).T).T)


def measure_spreads(values: Array, frames_per_packet: int) -> NDArray[np.uint8]:
    """(n, KINDS) codes of the mean size of what each kind of prediction leaves of (t, n) values."""
    errors: list[list[Array]] = [[] for _ in range(KINDS)]
    errors[0].append(np.abs(values))
    whole = np.rint(values * UNIT).astype(np.int64)
    for start in range(0, len(whole) - frames_per_packet, frames_per_packet):
        for kind, error in prediction_errors(whole[start : start + frames_per_packet + 1]):
            errors[kind].append(np.abs(error)[None] / UNIT)
    sizes = np.empty((values.shape[1], KINDS))
    for kind in range(KINDS):
        found = errors[kind] or errors[kind - 1]
        errors[kind] = found
        sizes[:, kind] = np.concatenate(found).mean(0)
    return spread_codes(sizes)


def prediction_errors(frames: Integers) -> Iterator[tuple[int, Integers]]:
    """The kinds of the predictions in a packet, and what each leaves (n,), no anchor being damped.

    frames: (count + 1, n) from the anchor before the packet on.
    """
    known = {0: frames[0]}
    for place in coding_order(len(frames) - 1):
        predicted = known[0] if place.kind == ANCHOR else interpolate(place, known)
        known[place.index] = frames[place.index]
        yield place.kind, frames[place.index] - predicted


def spread_codes(sizes: Array) -> NDArray[np.uint8]:
    """(n, KINDS) codes of mean sizes, units."""
    octaves = np.log2(np.maximum(sizes, 1e-6) * 16)
    codes = SPREAD_STEP * np.rint(4 / SPREAD_STEP * octaves)
    return np.asarray(np.clip(codes, 0, MAX_SPREAD - 1), np.uint8)


def _luma_motion(
    shape: ShapeFree, crop: Crop, face: FaceParameters, reference: Pose
) -> NDArray[np.float32]:
    """(k, GEOMETRY) grey levels per unit of each geometric value of y, by numeric differences."""
    y = vector_from_face(face, reference)
    grey = luma(crop.picture)
    columns = []
    for place, probe in enumerate(_PROBE):
        pair = []
        for sign in (1, -1):
            moved = y.copy()
            moved[place] += sign * probe
            near = FaceParameters(
                pose_from_motion(moved[:6], reference), clip_eau(moved[6:GEOMETRY])
            )
            pair.append(sample(grey, crop.from_frame(shape.positions(near)))[:, 0])
        columns.append((pair[0] - pair[1]) / (2 * probe))
    return np.asarray(np.stack(columns, 1), np.float32)
