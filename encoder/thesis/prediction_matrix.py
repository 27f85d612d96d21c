"""The steps of analysis by synthesis that the thesis takes: a prediction matrix (2.4.3).

For training, pose and actuators are displaced one by one (Table 2.4) in a picture whose face is
known.  The changes of the residual give the matrix Psi of eq. 2.27, which then predicts a
displacement from a residual (eq. 2.26).  The thesis trains on many people, once for all poses.
Here the pictures are of the person in the call, and each direction of view has its own matrix.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import (
    EAU_CHANGE_SIGMA,
    FitTarget,
    Observation,
    TexelFit,
    TexelFitter,
    cauchy_loss,
    cauchy_weights,
    solve_coefficients,
)
from encoder.fitting.gauss_newton import RELATIVE_TOLERANCE
from encoder.fitting.increments import FACE_PARAMETERS, RIGID, apply_increment
from runtime.image_ops import sample_bicubic
from shared_model.arrays import Array, Indices, Single
from shared_model.geometry import matrix_from_quaternion, rotation_angle_deg
from shared_model.parameters import FaceParameters

# Displacements of Table 2.4: shares of the face's width and height, degrees, scales, standard
# deviations of an actuator.
TRANSLATION_SHARES = (-0.1, -0.05, 0.05, 0.1)
ROTATIONS_DEG = (-15.0, -5.0, 5.0, 15.0)
SCALES = (0.9, 1.1)
EAU_SIGMAS = (-1.5, -0.5, 0.5, 1.5)
# Texels a side to which the table applies; a finer texture has finer features, and displacements
# are reduced in proportion.
TABLE_ATLAS_SIZE = 56
# Shares of a predicted step, in the order in which they are evaluated (3.1).
STEP_SHARES = (1.0, 1.5, 0.5)
# A direction of view this far from all others is trained for itself.
VIEW_SPACING_DEG = 5.0
# A matrix is trained again when the template's weight has increased by this factor.
RETRAIN_RATIO = 1.1
# Keeps equations solvable that no texel contributes to; the least gain of an illumination.
TINY, MIN_GAIN = 1e-6, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class TrainingView:
    """Derivatives of the residual about a known face; compared by identity.

    jacobian: (k, 6 + EAUs) grey levels, in the illumination of the first frame, per radian, mm and
        unit.
    weights: (k,) of the texels.  rotation: (3, 3) camera from head.  depth_mm: of the head.
    template_weight: sum of the template's weights at the time.
    side: which target it was trained with, see `PredictionMatrixFitter._target_of`.
    """

    jacobian: Single
    weights: Single
    rotation: Array
    depth_mm: float
    template_weight: float
    side: int


class PredictionMatrixFitter(TexelFitter):
    """A `TexelFitter` whose steps are predicted by trained matrices."""

    _views: tuple[TrainingView, ...] = ()
    # By view and active actuators.  A matrix is computed from the template at its first use, and
    # used until its view is trained again.
    _matrices: Mapping[tuple[TrainingView, tuple[int, ...]], tuple[Single, Array]] = (
        MappingProxyType({})
    )

    def train(self, crop: Crop, face: FaceParameters) -> None:
        """Train on a picture whose face is known, unless its direction of view is trained."""
        side = self._side_at(face)
        target = self._target_of(side)
        weight = float(target.template.weight.sum())
        near = [
            view
            for view in self._views
            if view.side == side and _roll_alignment(view, face)[1] < VIEW_SPACING_DEG
        ]
        if any(weight <= RETRAIN_RATIO * view.template_weight for view in near):
            return
        trained = TrainingView(
            self._measure_jacobian(target.shape, crop, face),
            target.template.weight * self._visible(target.shape.atlas, face),
            matrix_from_quaternion(face.pose.rotation),
            float(face.pose.translation_mm[2]),
            weight,
            side,
        )
        self._views = (*(view for view in self._views if view not in near), trained)
        self._matrices = {key: m for key, m in self._matrices.items() if key[0] not in near}

    def set_noise_level(self, residual_sigma_grey: float) -> None:
        """Do nothing: matrices are trained for the default noise level."""

    def observe(self, crop: Crop, initial: FaceParameters) -> Observation:
        """See `TexelFitter`: with the target that the nearest view was trained with."""
        side = self._nearest(self._views, initial).side if self._views else 0
        return self._observe(self._target_of(side), crop, initial)

    def _side_at(self, face: FaceParameters) -> int:
        """Which target a view of this direction is trained with."""
        return 0

    def _target_of(self, side: int) -> FitTarget:
        """0: the whole face, which this class knows alone."""
        return FitTarget(self.shape, self.template)

    def _side_of(self, observation: Observation) -> int:
        """Which target an observation was made with."""
        return 0

    def _nearest(self, views: Sequence[TrainingView], face: FaceParameters) -> TrainingView:
        return min(views, key=lambda view: _roll_alignment(view, face)[1])

    def fit(
        self,
        observation: Observation,
        start: FaceParameters,
        iterations: int,
        active: Sequence[int],
    ) -> TexelFit:
        """See `TexelFitter`.  Raises `ValueError` before the first training."""
        if not self._views:
            raise ValueError("no matrix has been trained, expected train before fit")
        free = np.asarray(active, np.intp)
        whole = len(self.template.modes)
        target = _Target(
            observation.target,
            observation.crop,
            np.ascontiguousarray(observation.luma_and_gradients[..., 0]),
            observation.weights,
            start.eau,
            observation.eau_precision,
        )
        side = self._side_of(observation)
        view = self._nearest([view for view in self._views if view.side == side], start)
        template = observation.target.template
        modes = start.modes if len(start.modes) == whole else np.zeros(whole)
        best = self._render(target, with_coefficients(start, modes, len(template.modes)))
        # No solver of `gauss_newton`: steps come from training, without equations that could be
        # damped; a step that is too long is shortened instead.
        for _ in range(iterations):
            step = self._predicted_step(view, target, best, free)
            before = best
            for share in STEP_SHARES:
                trial = self._render(target, apply_increment(best.face, share * step))
                if trial.cost < best.cost:
                    best = trial
                    break
            if before.cost - best.cost <= RELATIVE_TOLERANCE * before.cost:
                break
        modes = solve_coefficients(template, best.luma, target.weights)
        face = with_coefficients(best.face, modes, whole)
        return TexelFit(face, best.luma, target.weights)

    def _measure_jacobian(self, shape: ShapeFreeFrame, crop: Crop, face: FaceParameters) -> Single:
        """(k, 6 + EAUs) derivatives of the residual, from displacements smoothed by a Gaussian."""
        luma = self._normalise(crop.picture)

        def texels(at: FaceParameters) -> Single:
            return sample_bicubic(luma, crop.to_crop_px(shape.positions(at)))[:, 0]

        columns = [
            _smoothed_derivative(texels, face, index, steps)
            for index, steps in self._displacements(face)
        ]
        return np.asarray(np.stack(columns, 1) / np.float32(_gain(face)))

    def _displacements(self, face: FaceParameters) -> Iterator[tuple[int, list[float]]]:
        """Each parameter with its displacements (Table 2.4): radians, mm, units."""
        ratio = min(1.0, TABLE_ATLAS_SIZE / self.shape.atlas.size)
        corners = self.shape.atlas.corners[self.template.weight > 0]
        width, height = np.ptp(self._face.neutral[corners].reshape(-1, 3), axis=0)[:2]
        for index in range(3):
            yield index, [ratio * float(np.radians(angle)) for angle in ROTATIONS_DEG]
        yield 3, [ratio * share * float(width) for share in TRANSLATION_SHARES]
        yield 4, [ratio * share * float(height) for share in TRANSLATION_SHARES]
        depth_mm = float(face.pose.translation_mm[2])
        yield 5, [ratio * depth_mm * (1 / scale - 1) for scale in SCALES]
        for index in range(RIGID, FACE_PARAMETERS):
            yield index, [ratio * sigmas * EAU_CHANGE_SIGMA for sigmas in EAU_SIGMAS]

    def _render(self, target: "_Target", face: FaceParameters) -> "_Rendering":
        """The residual of `face` under the best illumination, `face.modes` being a first one."""
        template = target.model.template
        positions = target.crop.to_crop_px(target.model.shape.positions(face))
        luma = sample_bicubic(target.luma, positions)[:, 0]
        residual = luma - template.mean - face.modes.astype(np.float32) @ template.modes
        modes = solve_coefficients(template, luma, target.weights * cauchy_weights(residual))
        residual = luma - template.mean - modes.astype(np.float32) @ template.modes
        change = target.initial_eau - face.eau
        cost = float(target.weights @ cauchy_loss(residual))
        cost += target.eau_precision * float(change @ change)
        return _Rendering(replace(face, modes=modes), residual, luma, cost)

    def _predicted_step(
        self, view: TrainingView, target: "_Target", current: "_Rendering", free: Indices
    ) -> Array:
        """(6 + EAUs,) the displacement that explains the residual (eq. 2.26)."""
        psi, eau_gain = self._matrix(view, free)
        # No robust weights: the matrix was trained without, and steps would be too short.
        residual = current.residual * (target.weights > 0) / np.float32(_gain(current.face))
        eau_change = (target.initial_eau - current.face.eau)[free]
        solution = -(psi @ residual) + eau_gain @ eau_change
        roll, _ = _roll_alignment(view, current.face)
        step = np.zeros(FACE_PARAMETERS)
        depth_ratio = float(current.face.pose.translation_mm[2]) / view.depth_mm
        step[:3] = roll @ solution[:3]
        step[3:RIGID] = roll @ solution[3:RIGID] * [1, 1, depth_ratio]
        step[RIGID + free] = solution[RIGID:]
        return step

    def _matrix(self, view: TrainingView, free: Indices) -> tuple[Single, Array]:
        """Psi of eq. 2.27, (6 + a, k), illumination eliminated; the gain (6 + a, a) of the prior
        of actuators."""
        key = view, tuple(free.tolist())
        if key not in self._matrices:
            motion = view.jacobian[:, np.r_[0:RIGID, RIGID + free]]
            modes = self._target_of(view.side).template.modes
            rows = np.concatenate([motion, -modes.T], axis=1)
            weighted = rows * view.weights[:, None]
            normal = (rows.T @ weighted).astype(np.float64)
            size = RIGID + len(free)
            eau, precision = np.arange(RIGID, size), self.eau_precision(view.weights)
            normal[eau, eau] += precision
            normal[np.diag_indices(len(normal))] *= 1 + TINY
            normal[np.diag_indices(len(normal))] += TINY
            inverse = np.asarray(np.linalg.inv(normal), np.float64)[:size]
            psi = np.asarray(inverse @ weighted.T, np.float32)
            self._matrices = {**self._matrices, key: (psi, precision * inverse[:, eau])}
        return self._matrices[key]


@dataclass(frozen=True, slots=True)
class _Target:
    """A picture to fit: the model, luma of the crop (h, w), weights (k,) of the texels, prior of
    actuators."""

    model: FitTarget
    crop: Crop
    luma: Single
    weights: Single
    initial_eau: Array
    eau_precision: float


@dataclass(frozen=True, slots=True)
class _Rendering:
    """A face with the coefficients of its illumination; residual and luma (k,), grey levels."""

    face: FaceParameters
    residual: Single
    luma: Single
    cost: float


def with_coefficients(face: FaceParameters, modes: Array, count: int) -> FaceParameters:
    """The face with `count` coefficients: those given, cut or filled up with zeros."""
    padded, common = np.zeros(count), min(count, len(modes))
    padded[:common] = modes[:common]
    return replace(face, modes=padded)


def _smoothed_derivative(
    texels: Callable[[FaceParameters], Single],
    face: FaceParameters,
    index: int,
    steps: Sequence[float],
) -> Single:
    """(k,) derivative of texels by a parameter: a weighted mean of difference quotients.

    The weights are the Gaussian kernel of 2.4.3, as wide as the smallest displacement.
    """
    reference, width = texels(face), min(map(abs, steps))
    total, weight = np.zeros_like(reference), TINY
    for step in steps:
        displaced = apply_increment(face, step * np.eye(FACE_PARAMETERS)[index])
        # Less than the step where an actuator reaches its limit.
        change = step if index < RIGID else float((displaced.eau - face.eau)[index - RIGID])
        if change:
            kernel = float(np.exp(-0.5 * (change / width) ** 2))
            total += np.float32(kernel / change) * (texels(displaced) - reference)
            weight += kernel
    return total / np.float32(weight)


def _gain(face: FaceParameters) -> float:
    """Brightness relative to the first frame, from the first coefficient."""
    return max(1 + float(face.modes[0]), MIN_GAIN) if len(face.modes) else 1.0


def _roll_alignment(view: TrainingView, face: FaceParameters) -> tuple[Array, float]:
    """(3, 3) rotation about the optical axis that best aligns a view with `face`, and the angle
    that remains between them, degrees."""
    between = matrix_from_quaternion(face.pose.rotation) @ view.rotation.T
    angle = np.arctan2(between[1, 0] - between[0, 1], between[0, 0] + between[1, 1])
    c, s = np.cos(angle), np.sin(angle)
    roll = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return roll, rotation_angle_deg(roll.T @ between)
