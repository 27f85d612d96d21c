"""Who it is, from textures: shape, lens and the faces of several frames, adjusted together.

One frame's landmarks say little of depth.  Here the first frame's texture is fitted to several
frames at once, the residual of eq. 2.22 in each of them, by what they share as well: photometric
bundle adjustment.  The texture stays as it was taken, texel by texel, as a receiver has it; the
frame that it was taken from weighs as much as all others together and holds the shape in place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFreeFrame, rigid_jacobian
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
from encoder.fitting.identity import INACTIVE_EAU_SIGMA
from encoder.fitting.increments import (
    apply_identity_increment,
    identity_increment_between,
    shared_parameter_count,
)
from encoder.fitting.landmark_fit import EAU_PRIOR_SIGMA
from encoder.fitting.levenberg_marquardt import Damping, Evaluation, levenberg_marquardt
from encoder.runtime.image_ops import sample_bicubic
from shared_model.animate import Face
from shared_model.anthropometry import residual_basis
from shared_model.appearance import Atlas
from shared_model.mesh import Head
from shared_model.parameters import EAUS

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Standard deviation of the residual between different views of a face, grey levels, and the Cauchy
# scale of its outliers.  Shading and shape err more from view to view than from frame to frame.
VIEW_RESIDUAL_SIGMA_GREY, VIEW_CAUCHY_SCALE_GREY = 8.0, 20.0
# What the first frame's landmarks are worth: they err together, and more than they scatter.
LANDMARKS_SHARE = 0.2
# The expression of the first frame stays, or faults of the shape would pass for it.
HELD_SIGMA = 0.01
# The lens is known from the first frame to so much of its logarithm: what faces do in front of it
# would pass for its perspective.
LOG_FOCAL_CHANGE_SIGMA = 0.03
STEPS = 8
DAMPING = Damping(initial=1e-3, least_after_increase=0.0, decrease=5.0)
# Turns of weighing outliers in what the light is made of.
LIGHT_TURNS = 3
PER_FRAME = 6 + len(EAUS)


@dataclass(frozen=True, slots=True)
class Adjustment:
    """What it came to.

    left_grey2: mean square of what the views but the first leave, outliers less, grey levels.
    """

    fitted: IdentityFit
    residual_mse_grey2: float


class PhotometricBundleAdjustment:
    """One caller's first frame with its texture, and what else may be learned of it.

    origin: the caller in that frame alone, with its information.
    target: the texture; its modes are gain, offset and slopes of light.
    active: actuators that move from frame to frame.
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
        self._aau = aau.astype(np.float32)
        controls = np.einsum("kc,nkc->nk", weights, residual_basis(head)[:, corners])
        self._controls = controls.astype(np.float32)
        self._prior = _held(origin.information)

    def adjust(self, fitted: IdentityFit, views: Sequence[Observation]) -> Adjustment:
        """Shape, lens and faces that explain all views best.

        fitted: where to start; its frames are the views', the origin's first.
        """
        return self._solve(fitted, views, 0)

    def resect(self, fitted: IdentityFit, views: Sequence[Observation]) -> Adjustment:
        """The same with shape, lens and the first face as they are."""
        return self._solve(fitted, views, len(self._prior))

    def _solve(self, fitted: IdentityFit, views: Sequence[Observation], fixed: int) -> Adjustment:
        """Fit all parameters from number `fixed` on."""

        def apply_step(fitted: IdentityFit, step: Array) -> IdentityFit:
            whole = np.concatenate([np.zeros(fixed), step])
            return apply_identity_increment(self._head, fitted, whole)

        found, evaluation = levenberg_marquardt(
            lambda fitted: self._attempt(fitted, views, fixed), fitted, apply_step, DAMPING, STEPS
        )
        return Adjustment(found, evaluation.residual_mse_grey2)

    def _attempt(
        self, fitted: IdentityFit, views: Sequence[Observation], fixed: int
    ) -> "_BundleEvaluation":
        shape = ShapeFreeFrame(Face(self._head, fitted.identity), self._atlas, fitted.camera)
        shared = shared_parameter_count(fitted)
        size = shared + PER_FRAME * len(views)
        normal, gradient = np.zeros((size, size)), np.zeros(size)
        away, first = identity_increment_between(self._origin, fitted), slice(0, len(self._prior))
        normal[first, first] = self._prior
        gradient[first] = -self._prior @ away
        cost, left_grey2 = float(away @ self._prior @ away), 0.0
        share = 1 / (CORRELATED_TEXELS * VIEW_RESIDUAL_SIGMA_GREY**2)
        others = len(views) - 1
        for number, view in enumerate(views):
            seen = self._compared(shape, fitted, number, view)
            worth = share if number else max(others, 1) * share
            own = shared + PER_FRAME * number
            place = np.r_[:shared, own : own + 6, own + 6 + self._active]
            normal[np.ix_(place, place)] += worth * seen.normal
            gradient[place] += worth * seen.gradient
            cost += worth * seen.cost
            if number:
                left_grey2 += seen.cost / float(view.weights.sum()) / others
                cost += self._expect_rest(fitted.frames[number].eau, normal, gradient, own + 6)
        equations = normal[fixed:, fixed:], gradient[fixed:]
        return _BundleEvaluation(cost, lambda: equations, left_grey2)

    def _expect_rest(self, eau: Array, normal: Array, gradient: Array, at: int) -> float:
        """Add what is known of actuators, those from number `at` on, to the equations; its cost."""
        every, own = at + np.arange(len(eau)), at + self._active
        precision = np.full(len(eau), 1 / INACTIVE_EAU_SIGMA**2)
        precision[self._active] = 1 / EAU_PRIOR_SIGMA**2
        normal[every, every] += precision
        gradient[own] -= eau[self._active] / EAU_PRIOR_SIGMA**2
        return float(np.sum(eau[self._active] ** 2)) / EAU_PRIOR_SIGMA**2

    def _compared(
        self, shape: ShapeFreeFrame, fitted: IdentityFit, number: int, view: Observation
    ) -> "_Compared":
        """What one view says of all that is shared, of its pose and of active actuators."""
        placed = shape.project(fitted.frames[number])
        seen = sample_bicubic(view.luma_and_gradients, view.crop.to_crop_px(placed.pixels))
        left, weight = self._unlit(seen[:, 0], view.weights)
        cost = float(view.weights @ cauchy_loss(left, VIEW_CAUCHY_SCALE_GREY))
        root = np.sqrt(weight)
        slope = np.ascontiguousarray((seen[:, 1:] * view.crop.scale.astype(np.float32)).T) * root
        rigid = rigid_jacobian(placed.rotated_mm, placed.camera_mm, placed.pixels_per_mm, slope)
        back = placed.rotation.T @ rigid[3:]
        depth_mm = np.float32(fitted.frames[number].pose.translation_mm[2])
        centre = fitted.camera.centre.astype(np.float32)[:, None]
        # The face goes away with the focal length, see `refocused`.
        focal = ((placed.pixels.T - centre) * slope).sum(0) + rigid[5] * depth_mm
        aau = (self._aau * back).sum(1)
        controls = (self._controls[:, None] * back).reshape(-1, len(root))
        own = shape.image_jacobian(placed, slope, self._active)
        rows = np.concatenate([focal[None], aau, controls, own])
        light = self._template.modes * root
        normal = (rows @ rows.T).astype(np.float64)
        across = (rows @ light.T).astype(np.float64)
        among = (light @ light.T).astype(np.float64)
        # The light is whatever suits the rest best.
        normal -= across @ np.linalg.lstsq(among, across.T, rcond=None)[0]
        return _Compared(normal, -(rows @ (root * left)).astype(np.float64), cost)

    def _unlit(self, grey: Single, shown: Single) -> tuple[Single, Single]:
        """(k,) what texture and light leave of a view's luma, and the texels' weights."""
        weight = shown
        for _ in range(LIGHT_TURNS):
            light = solve_coefficients(self._template, grey, weight).astype(np.float32)
            left = grey - self._template.mean - light @ self._template.modes
            weight = shown * cauchy_weights(left, VIEW_CAUCHY_SCALE_GREY)
        return left, weight


@dataclass(frozen=True, slots=True)
class _Compared:
    """Normal equations over shared and own parameters, (n, n) and (n,), and robust cost."""

    normal: Array
    gradient: Array
    cost: float


@dataclass(frozen=True, slots=True)
class _BundleEvaluation(Evaluation):
    """left_grey2: see `Adjusted`."""

    residual_mse_grey2: float


def _held(information: Array) -> Array:
    """What the first frame's landmarks are believed: less, with expression and lens held."""
    prior = LANDMARKS_SHARE * information
    prior[0, 0] += 1 / LOG_FOCAL_CHANGE_SIGMA**2
    expression = np.arange(len(prior) - len(EAUS), len(prior))
    prior[expression, expression] += 1 / HELD_SIGMA**2
    return prior
