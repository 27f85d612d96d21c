"""Photometric bundle adjustment: shape, focal length and the faces of several frames together.

Landmarks of one frame determine depth poorly.  Here the texture of the first frame is fitted to
several frames at once, by the residual of eq. 2.22 in each of them and by the parameters that they
share.  The texture stays fixed texel by texel, as at the receiver.  The first frame has as much
weight as all others together and thereby holds the shape in place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from encoder.appearance.shape_free import ProjectedTexels, ShapeFreeFrame, rigid_jacobian
from encoder.appearance.template import Template
from encoder.fitting.analysis_by_synthesis import (
    CORRELATED_TEXELS,
    FitTarget,
    Observation,
    cauchy_loss,
    cauchy_weights,
    solve_coefficients,
)
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.gauss_newton import Damping, Evaluation, levenberg_marquardt
from encoder.fitting.identity import INACTIVE_EAU_SIGMA
from encoder.fitting.increments import (
    FACE_PARAMETERS,
    RIGID,
    apply_identity_increment,
    identity_increment_between,
    shared_parameter_count,
)
from encoder.fitting.landmark_fit import EAU_PRIOR_SIGMA
from runtime.image_ops import sample_bicubic
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.arrays import Array, Single
from shared_model.mesh import Head
from shared_model.parameters import EAUS
from shared_model.shape_residual import residual_basis

# Standard deviation of the residual of one frame's texture in other views of the face, grey levels,
# and the Cauchy scale of its outliers.
VIEW_RESIDUAL_SIGMA_GREY, VIEW_CAUCHY_SCALE_GREY = 8.0, 20.0
# Weight of the first frame's landmarks: their errors are correlated, and exceed their scatter.
LANDMARK_PRIOR_WEIGHT = 0.2
# Of the first frame's actuators: a freer expression would absorb errors of the shape.
EXPRESSION_PRIOR_SIGMA = 0.01
# Of the logarithm of the focal length about that of the first frame: a freer one would absorb
# motion of the face.
LOG_FOCAL_CHANGE_SIGMA = 0.03
MAX_ITERATIONS = 8
DAMPING = Damping(initial=1e-3, least_after_increase=0.0, decrease=5.0)
# Rounds of reweighting outliers when the illumination is fitted.
IRLS_ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Adjustment:
    """The result of an adjustment.

    residual_mse_grey2: robust mean square residual of all views but the first, squared grey levels.
    """

    fitted: IdentityFit
    residual_mse_grey2: float


class PhotometricBundleAdjustment:
    """Adjusts the identity of one person, given their first frame and its texture.

    origin: the identity fitted to that frame alone, with its information.
    target: the texture; its modes are gain, offset and slopes of illumination.
    active: actuators that move from frame to frame.
    Raises `ValueError` where `origin` has no information.
    """

    def __init__(
        self, head: Head, origin: IdentityFit, target: FitTarget, active: Sequence[int]
    ) -> None:
        if origin.information is None:
            raise ValueError("origin has no information, expected that of one frame's landmarks")
        self._head, self._origin, self._active = head, origin, np.asarray(active, np.intp)
        self._atlas: Atlas = target.shape.atlas
        self._template: Template = target.template
        corners, weights = self._atlas.corners, self._atlas.weights
        aau = np.einsum("kc,akcd->adk", weights, head.aau[:, corners])
        self._aau_fields = aau.astype(np.float32)
        controls = np.einsum("kc,nkc->nk", weights, residual_basis(head)[:, corners])
        self._control_weights = controls.astype(np.float32)
        self._prior = _first_frame_prior(origin.information)

    def adjust(self, fitted: IdentityFit, views: Sequence[Observation]) -> Adjustment:
        """Fit shape, focal length and all faces to all views.

        fitted: the initial estimate; its frames are those of the views, the first one the origin's.
        """
        return self._solve(fitted, views, 0)

    def resect(self, fitted: IdentityFit, views: Sequence[Observation]) -> Adjustment:
        """Fit the faces of all views but the first; all other parameters are fixed."""
        return self._solve(fitted, views, len(self._prior))

    def _solve(self, fitted: IdentityFit, views: Sequence[Observation], fixed: int) -> Adjustment:
        """Fit all parameters but the first `fixed` ones."""

        def apply_step(fitted: IdentityFit, step: Array) -> IdentityFit:
            padded = np.concatenate([np.zeros(fixed), step])
            return apply_identity_increment(self._head, fitted, padded)

        result, evaluation = levenberg_marquardt(
            lambda fitted: self._evaluate(fitted, views, fixed),
            fitted,
            apply_step,
            DAMPING,
            MAX_ITERATIONS,
        )
        return Adjustment(result, evaluation.residual_mse_grey2)

    def _evaluate(
        self, fitted: IdentityFit, views: Sequence[Observation], fixed: int
    ) -> "_BundleEvaluation":
        shape = ShapeFreeFrame(Face(self._head, fitted.identity), self._atlas, fitted.camera)
        shared = shared_parameter_count(fitted)
        size = shared + FACE_PARAMETERS * len(views)
        normal, right = np.zeros((size, size)), np.zeros(size)
        change, first = identity_increment_between(self._origin, fitted), slice(len(self._prior))
        normal[first, first] = self._prior
        right[first] = -self._prior @ change
        cost, mse_grey2 = float(change @ self._prior @ change), 0.0
        weight = 1 / (CORRELATED_TEXELS * VIEW_RESIDUAL_SIGMA_GREY**2)
        others = len(views) - 1
        for number, view in enumerate(views):
            equations = self._view_equations(shape, fitted, number, view)
            view_weight = weight if number else max(others, 1) * weight
            own = shared + FACE_PARAMETERS * number
            index = np.r_[:shared, own : own + RIGID, own + RIGID + self._active]
            normal[np.ix_(index, index)] += view_weight * equations.normal
            right[index] += view_weight * equations.right
            cost += view_weight * equations.cost
            if number:
                mse_grey2 += equations.cost / float(view.weights.sum()) / others
                cost += self._add_eau_prior(fitted.frames[number].eau, normal, right, own + RIGID)
        reduced = normal[fixed:, fixed:], right[fixed:]
        return _BundleEvaluation(cost, lambda: reduced, mse_grey2)

    def _add_eau_prior(self, eau: Array, normal: Array, right: Array, offset: int) -> float:
        """Add the actuators' prior to the equations, from parameter `offset` on; its cost."""
        every, active = offset + np.arange(len(eau)), offset + self._active
        precision = np.full(len(eau), 1 / INACTIVE_EAU_SIGMA**2)
        precision[self._active] = 1 / EAU_PRIOR_SIGMA**2
        normal[every, every] += precision
        right[active] -= eau[self._active] / EAU_PRIOR_SIGMA**2
        return float(np.sum(eau[self._active] ** 2)) / EAU_PRIOR_SIGMA**2

    def _view_equations(
        self, shape: ShapeFreeFrame, fitted: IdentityFit, number: int, view: Observation
    ) -> "_ViewEquations":
        """Equations of one view, the illumination eliminated from them (Schur complement)."""
        texels = shape.project(fitted.frames[number])
        samples = sample_bicubic(view.luma_and_gradients, view.crop.to_crop_px(texels.pixels))
        residual, weights = self._without_illumination(samples[:, 0], view.weights)
        cost = float(view.weights @ cauchy_loss(residual, VIEW_CAUCHY_SCALE_GREY))
        root = np.sqrt(weights)
        scale = view.crop.scale.astype(np.float32)
        gradient = np.ascontiguousarray((samples[:, 1:] * scale).T) * root
        own = shape.image_jacobian(texels, gradient, self._active)
        rows = np.concatenate([self._shared_jacobian(fitted, texels, gradient), own])
        light = self._template.modes * root
        normal = (rows @ rows.T).astype(np.float64)
        mixed = (rows @ light.T).astype(np.float64)
        light_normal = (light @ light.T).astype(np.float64)
        normal -= mixed @ np.linalg.lstsq(light_normal, mixed.T, rcond=None)[0]
        right = -(rows @ (root * residual)).astype(np.float64)
        return _ViewEquations(normal, right, cost)

    def _shared_jacobian(
        self, fitted: IdentityFit, texels: ProjectedTexels, gradient: Single
    ) -> Single:
        """(n, k) how texels change by log f, AAUs and controls; gradient: (2, k) per pixel."""
        rigid = rigid_jacobian(texels.rotated_mm, texels.camera_mm, texels.pixels_per_mm, gradient)
        head_gradient = texels.rotation.T @ rigid[3:]
        depth_mm = np.float32(texels.face.pose.translation_mm[2])
        centre = fitted.camera.centre.astype(np.float32)[:, None]
        # Depth changes in proportion to the focal length, see `with_focal_change`.
        focal = ((texels.pixels.T - centre) * gradient).sum(0) + rigid[5] * depth_mm
        aau = (self._aau_fields * head_gradient).sum(1)
        controls = self._control_weights[:, None] * head_gradient
        return np.concatenate([focal[None], aau, controls.reshape(-1, len(focal))])

    def _without_illumination(self, luma: Single, weights: Single) -> tuple[Single, Single]:
        """(k,) residual of luma (k,) under the best illumination, and the texels' weights (k,)."""
        robust = weights
        for _ in range(IRLS_ROUNDS):
            light = solve_coefficients(self._template, luma, robust).astype(np.float32)
            residual = luma - self._template.mean - light @ self._template.modes
            robust = weights * cauchy_weights(residual, VIEW_CAUCHY_SCALE_GREY)
        return residual, robust


@dataclass(frozen=True, slots=True)
class _ViewEquations:
    """Normal equations over shared and own parameters, (n, n) and (n,), and the robust cost."""

    normal: Array
    right: Array
    cost: float


@dataclass(frozen=True, slots=True)
class _BundleEvaluation(Evaluation):
    """residual_mse_grey2: see `Adjustment`."""

    residual_mse_grey2: float


def _first_frame_prior(information: Array) -> Array:
    """(n, n) precision of the first frame's parameters, from its landmarks' information."""
    prior = LANDMARK_PRIOR_WEIGHT * information
    prior[0, 0] += 1 / LOG_FOCAL_CHANGE_SIGMA**2
    expression = np.arange(len(prior) - len(EAUS), len(prior))
    prior[expression, expression] += 1 / EXPRESSION_PRIOR_SIGMA**2
    return prior
