"""The thesis' own step of the analysis by synthesis (2.4.3): a prediction matrix made beforehand.

Pose and actuators are displaced one by one (Table 2.4) on pictures whose face is known; how the
residual changes gives the matrix Psi of eq. 2.27, which then predicts a displacement from the
residual alone (eq. 2.26).  The thesis trains on many people, once for all poses; here the pictures
are the caller's own, with a matrix for each direction in which they have looked.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import (
    EAU_CHANGE_SIGMA,
    Observation,
    TexelFit,
    TexelFitter,
    cauchy_loss,
    cauchy_weights,
    solve_coefficients,
)
from encoder.fitting.increments import apply_increment
from encoder.fitting.levenberg_marquardt import RELATIVE_TOLERANCE
from encoder.runtime.image_ops import sample_bicubic
from shared_model.geometry import matrix_from_quaternion
from shared_model.parameters import EAUS, FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Table 2.4: shares of the face's width and height, degrees, scales, standard deviations.
SHARES = (-0.1, -0.05, 0.05, 0.1)
TURNS_DEG = (-15.0, -5.0, 5.0, 15.0)
SCALES = (0.9, 1.1)
DEVIATIONS = (-1.5, -0.5, 0.5, 1.5)
# Texels a side for which they are meant: of a finer texture the features are passed sooner.
TABLE_ATLAS = 56
# Along one prediction, in the order in which they are tried (3.1).
STEPS = (1.0, 1.5, 0.5)
# A face that looks this far aside of all known directions gets a matrix of its own.
APART_DEG = 5.0
# Texels known by which a matrix is outdated.
GROWN = 1.1
# Keeps equations solvable that no texel takes part in; the gain of a light, at least.
TINY, LEAST_GAIN = 1e-6, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Training:
    """How the residual changes about a known face; equal to itself alone.

    change: (k, 6 + EAUs) grey levels of the first frame's light per radian, mm and unit.
    weight: (k,) of the texels that took part.  rotation: (3, 3) camera from head.
    depth_mm: of the head.  texels: the template's weight at the time.
    """

    change: Single
    weight: Single
    rotation: Array
    depth_mm: float
    texels: float


class PredictionMatrixFitter(TexelFitter):
    """A `Refiner` whose steps are predicted by matrices made beforehand."""

    _trained: tuple[Training, ...] = ()
    # By training and active actuators.  Each is of the template as it was when first needed, and
    # kept until the training is outdated.
    _matrices: Mapping[tuple[Training, tuple[int, ...]], tuple[Single, Array]] = MappingProxyType(
        {}
    )

    def learn(self, crop: Crop, face: FaceParameters) -> None:
        """Train on a picture whose face is known, unless its direction has been trained."""
        texels = float(self.template.weight.sum())
        near = [known for known in self._trained if _turned(known, face)[1] < APART_DEG]
        if any(texels <= GROWN * known.texels for known in near):
            return
        made = Training(
            self._displaced(crop, face),
            self.template.weight * self.visible(face),
            matrix_from_quaternion(face.pose.rotation),
            float(face.pose.translation_mm[2]),
            texels,
        )
        self._trained = (*(known for known in self._trained if known not in near), made)
        self._matrices = {k: found for k, found in self._matrices.items() if k[0] not in near}

    def expect(self, noise_grey: float) -> None:
        """Nothing: the matrices are made for the usual noise."""

    def explain(
        self, view: Observation, start: FaceParameters, iterations: int, active: Sequence[int]
    ) -> TexelFit:
        """See `Refiner`.  Raises `ValueError` before the first picture to train on."""
        if not self._trained:
            raise ValueError("no matrix has been trained, expected learn before explain")
        free, grey = (
            np.asarray(active, np.intp),
            np.ascontiguousarray(view.luma_and_gradients[..., 0]),
        )
        seen = _Seen(view.crop, grey, view.weights, start, view.eau_precision)
        known = min(self._trained, key=lambda known: _turned(known, start)[1])
        modes = len(self.template.modes)
        light = start.modes if len(start.modes) == modes else np.zeros(modes)
        best = self._tried(seen, replace(start, modes=light))
        for _ in range(iterations):
            step = self._predicted(known, seen, best, free)
            before = best
            for share in STEPS:
                trial = self._tried(seen, apply_increment(best.face, share * step))
                if trial.cost < best.cost:
                    best = trial
                    break
            if before.cost - best.cost <= RELATIVE_TOLERANCE * before.cost:
                break
        found = replace(best.face, modes=solve_coefficients(self.template, best.grey, view.weights))
        return TexelFit(found, best.grey, view.weights)

    def _displaced(self, crop: Crop, face: FaceParameters) -> Single:
        """(k, 6 + EAUs) change of the residual, from displacements smoothed by a Gaussian."""
        grey = self._normalise(crop.picture)

        def shown(at: FaceParameters) -> Single:
            return sample_bicubic(grey, crop.to_crop_px(self.shape.positions(at)))[:, 0]

        slopes = [_slope(shown, face, index, steps) for index, steps in self._displacements(face)]
        return np.asarray(np.stack(slopes, 1) / np.float32(_gain(face)))

    def _displacements(self, face: FaceParameters) -> Iterator[tuple[int, list[float]]]:
        """Each parameter with its displacements (Table 2.4): radians, mm, units."""
        reach = min(1.0, TABLE_ATLAS / self.shape.atlas.size)
        corners = self.shape.atlas.corners[self.template.weight > 0]
        width, height = np.ptp(self._face.neutral[corners].reshape(-1, 3), axis=0)[:2]
        for index in range(3):
            yield index, [reach * float(np.radians(turn)) for turn in TURNS_DEG]
        yield 3, [reach * share * float(width) for share in SHARES]
        yield 4, [reach * share * float(height) for share in SHARES]
        depth_mm = float(face.pose.translation_mm[2])
        yield 5, [reach * depth_mm * (1 / scale - 1) for scale in SCALES]
        for index in range(6, 6 + len(EAUS)):
            yield index, [reach * deviation * EAU_CHANGE_SIGMA for deviation in DEVIATIONS]

    def _tried(self, seen: "_Seen", face: FaceParameters) -> "_Tried":
        """The residual of `face` under the light that explains it best, `face.modes` near it."""
        template = self.template
        grey = sample_bicubic(seen.grey, seen.crop.to_crop_px(self.shape.positions(face)))[:, 0]
        left = grey - template.mean - face.modes.astype(np.float32) @ template.modes
        modes = solve_coefficients(template, grey, seen.shown * cauchy_weights(left))
        left = grey - template.mean - modes.astype(np.float32) @ template.modes
        away = seen.start.eau - face.eau
        cost = float(seen.shown @ cauchy_loss(left)) + seen.precision * float(away @ away)
        return _Tried(replace(face, modes=modes), left, grey, cost)

    def _predicted(
        self, known: Training, seen: "_Seen", at: "_Tried", free: NDArray[np.intp]
    ) -> Array:
        """(6 + EAUs,) the displacement that explains what is left (eq. 2.26)."""
        psi, pull = self._matrix(known, free)
        # No robust weights: the matrix was made without, and would take too short a step.
        residual = at.left * (seen.shown > 0) / np.float32(_gain(at.face))
        found = -(psi @ residual) + pull @ (seen.start.eau - at.face.eau)[free]
        turn, _ = _turned(known, at.face)
        step = np.zeros(6 + len(EAUS))
        nearer = float(at.face.pose.translation_mm[2]) / known.depth_mm
        step[:3] = turn @ found[:3]
        step[3:6] = turn @ found[3:6] * [1, 1, nearer]
        step[6 + free] = found[6:]
        return step

    def _matrix(self, known: Training, free: NDArray[np.intp]) -> tuple[Single, Array]:
        """Psi of eq. 2.27, (6 + a, k), light aside; what a unit off the first guess pulls back."""
        key = known, tuple(free.tolist())
        if key not in self._matrices:
            moves = known.change[:, np.r_[0:6, 6 + free]]
            rows = np.concatenate([moves, -self.template.modes.T], axis=1)
            weighted = rows * known.weight[:, None]
            normal = (rows.T @ weighted).astype(np.float64)
            eau, precision = np.arange(6, 6 + len(free)), self.eau_precision(known.weight)
            normal[eau, eau] += precision
            normal[np.diag_indices(len(normal))] *= 1 + TINY
            normal[np.diag_indices(len(normal))] += TINY
            inverse = np.asarray(np.linalg.inv(normal), np.float64)[: 6 + len(free)]
            psi = np.asarray(inverse @ weighted.T, np.float32)
            self._matrices = {**self._matrices, key: (psi, precision * inverse[:, eau])}
        return self._matrices[key]


@dataclass(frozen=True, slots=True)
class _Seen:
    """A picture to explain: its grey levels, the texels' weights, the first guess."""

    crop: Crop
    grey: Single
    shown: Single
    start: FaceParameters
    precision: float


@dataclass(frozen=True, slots=True)
class _Tried:
    """A face with the coefficients of its light; what they leave (k,), grey levels, cost."""

    face: FaceParameters
    left: Single
    grey: Single
    cost: float


def _slope(
    shown: Callable[[FaceParameters], Single],
    face: FaceParameters,
    index: int,
    steps: Sequence[float],
) -> Single:
    """(k,) how what is shown changes with a parameter: a mean over displacements, near ones first.

    The Gaussian kernel of 2.4.3 is as wide as the least displacement.
    """
    before, width = shown(face), min(map(abs, steps))
    total, worth = np.zeros_like(before), TINY
    for step in steps:
        displaced = apply_increment(face, step * np.eye(6 + len(EAUS))[index])
        # An actuator may be at its end.
        done = step if index < 6 else float((displaced.eau - face.eau)[index - 6])
        if done:
            kernel = float(np.exp(-0.5 * (done / width) ** 2))
            total += np.float32(kernel / done) * (shown(displaced) - before)
            worth += kernel
    return total / np.float32(worth)


def _gain(face: FaceParameters) -> float:
    """How much brighter than at first the face is lit, by the first of its coefficients."""
    return max(1 + float(face.modes[0]), LEAST_GAIN) if len(face.modes) else 1.0


def _turned(known: Training, face: FaceParameters) -> tuple[Array, float]:
    """(3, 3) turn about the optical axis that brings a known face nearest to `face`; what is left
    between them, degrees."""
    between = matrix_from_quaternion(face.pose.rotation) @ known.rotation.T
    angle = np.arctan2(between[1, 0] - between[0, 1], between[0, 0] + between[1, 1])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    cosine = (np.trace(turn.T @ between) - 1) / 2
    return turn, float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
