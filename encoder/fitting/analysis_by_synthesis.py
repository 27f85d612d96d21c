"""Analysis by synthesis in the shape-free frame (thesis 2.4.3, 4.4).

Pose, actuators and appearance coefficients minimise the residual r = g_image - g_model of the
texels (eq. 2.22).  Each step solves the normal equations of eq. 2.27 for all of them.  The
derivative of the residual is the gradient of the picture at hand along the motion of the texels,
and therefore holds at any pose.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.appearance.texel_visibility import DEPTH_CELL_MM, visible_texels
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.gauss_newton import (
    Damping,
    Equations,
    Evaluation,
    levenberg_marquardt,
)
from encoder.fitting.increments import RIGID, actuator_room, apply_picture_step
from runtime.cauchy_weight import cauchy_weight
from runtime.image_ops import sample_bicubic
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.arrays import Array, Indices, Mask, Picture, Single
from shared_model.parameters import EAUS, FaceParameters

# Standard deviation of an actuator about its initial estimate, which comes from the previous frame
# or from landmarks.
EAU_CHANGE_SIGMA = 0.25
# Standard deviation of the residual, grey levels, where no fit has measured it, and at most; the
# Cauchy scale, above which texels count as outliers (a hand, a highlight), at most.
RESIDUAL_SIGMA_GREY, CAUCHY_SCALE_GREY = 6.0, 25.0
# The Cauchy scale in standard deviations of the residual: 95 % efficiency for Gaussian noise; the
# least standard deviation that is assumed.
CAUCHY_SCALE_SIGMAS = 2.4
MIN_RESIDUAL_SIGMA_GREY = 2.0
# Keeps equations solvable that no texel contributes to.
TINY = 1e-9
# Fits start near their solution: steps are undamped until one raises the cost.
PICTURE_DAMPING = Damping(
    initial=0.0,
    least_after_increase=0.1,
    decrease=10.0,
    relative_ridge=1e-6,
    absolute_ridge=TINY,
)
# Errors of neighbouring texels are correlated; this many texels count as one measurement.
CORRELATED_TEXELS = 10.0
# What is hidden, as by a hand, counts so much as if it showed the mean: coefficients that nothing
# else shows stay small.
HIDDEN_WEIGHT = 0.1
# Approximate number of texels that a fit samples.
NOMINAL_TEXELS = 5000


@dataclass(frozen=True, slots=True)
class FitTarget:
    """The model of a fit: texels on the moving head, and the template of their luma."""

    shape: ShapeFreeFrame
    template: Template


@dataclass(frozen=True, slots=True)
class Observation:
    """A picture prepared for fits.

    luma_and_gradients: (h, w, 3) the crop's luma and its gradients, grey levels per crop pixel.
    weights: (k,) of the texels, 0 where invisible.
    eau_precision: see `TexelFitter.eau_precision`.
    hidden: (k,) texels that the crop does not show; None: it shows all.
    """

    target: FitTarget
    crop: Crop
    luma_and_gradients: Single
    weights: Single
    eau_precision: float
    hidden: Mask | None = None


@dataclass(frozen=True, slots=True)
class TexelFit:
    """A fitted face with its coefficients; luma (k,) and weights (k,) of its texels."""

    face: FaceParameters
    luma: Single
    weights: Single


class TexelFitter:
    """Fits the textured model of one person to pictures.

    shape: all texels.  template: their luma.
    normalise: takes a BGR picture to the (h, w) values that the template describes.
    cell_mm: see `visible_texels`; for the spacing of all texels.
    nominal_texels: fit about so many of them.
    """

    def __init__(
        self,
        face: Face,
        shape: ShapeFreeFrame,
        template: Template,
        normalise: Callable[[Picture], Single] = luma_f32,
        cell_mm: float = DEPTH_CELL_MM,
        nominal_texels: int = NOMINAL_TEXELS,
    ) -> None:
        self._face, self._normalise = face, normalise
        stride = max(1, round(np.sqrt(len(shape) / nominal_texels)))
        atlas = shape.atlas
        self._residual_sigma_grey, self._cauchy_scale_grey = RESIDUAL_SIGMA_GREY, CAUCHY_SCALE_GREY
        sampled = every_nth_texel(atlas, stride)
        self._sampled, self._stride, self._cell_mm = sampled, stride, cell_mm * stride
        self.shape = ShapeFreeFrame(face, atlas.subset(sampled), shape.camera)
        self.template = template.subset(sampled)
        self._halved: Self | None = None

    def with_mode(self, mode: Single) -> Self:
        """A copy whose template has one more mode, luma (k,) of all texels."""
        fitter, template = copy(self), self.template
        modes = np.concatenate([template.modes, mode[None, self._sampled]])
        fitter.template, fitter._halved = replace(template, modes=modes), None
        return fitter

    @property
    def halved(self) -> Self:
        """A fitter of half the rows and columns of texels, for pictures of half the resolution."""
        if self._halved is None:
            fitter, stride = copy(self), 2 * self._stride
            kept = every_nth_texel(self.shape.atlas, stride)
            fitter.shape, fitter.template = self.shape.subset(kept), self.template.subset(kept)
            fitter._stride, fitter._cell_mm = stride, 2 * self._cell_mm
            self._halved = fitter
        return self._halved

    def set_noise_level(self, residual_sigma_grey: float) -> None:
        """Set the standard deviation of residuals: less noise needs less evidence of a motion."""
        sigma = max(residual_sigma_grey, MIN_RESIDUAL_SIGMA_GREY)
        self._residual_sigma_grey = min(sigma, RESIDUAL_SIGMA_GREY)
        self._cauchy_scale_grey = min(CAUCHY_SCALE_SIGMAS * sigma, CAUCHY_SCALE_GREY)

    def visible(self, face: FaceParameters) -> Mask:
        """(k,) whether the camera sees each texel."""
        return self._visible(self.shape.atlas, face)

    def _visible(self, atlas: Atlas, face: FaceParameters) -> Mask:
        vertices = self._face.animate(face.eau)
        return visible_texels(atlas, face.pose, vertices, self._cell_mm)

    def fit_crop(
        self,
        crop: Crop,
        start: FaceParameters,
        iterations: int,
        active: Sequence[int] = range(len(EAUS)),
    ) -> FaceParameters:
        """Observe a crop at `start` and fit it, see `fit`: the face with its coefficients."""
        return self.fit(self.observe(crop, start), start, iterations, active).face

    def observe(self, crop: Crop, initial: FaceParameters) -> Observation:
        """Prepare a picture for fits; texels that `initial` hides get no weight."""
        return self._observe(FitTarget(self.shape, self.template), crop, initial)

    def fit(
        self,
        observation: Observation,
        start: FaceParameters,
        iterations: int,
        active: Sequence[int],
    ) -> TexelFit:
        """The face of least cost that a few iterations from `start` reach.

        start: initial pose, actuators and, if as many as the template's modes, coefficients.
        active: actuators that are fitted; the others keep the values of `start`.
        """
        template, free = observation.target.template, np.asarray(active, np.intp)
        count = len(template.modes)
        modes = start.modes if len(start.modes) == count else np.zeros(count)
        face, best = levenberg_marquardt(
            lambda face: self._evaluate(observation, face, start.eau, free),
            replace(start, modes=modes),
            lambda face, step: apply_picture_step(face, step, free),
            PICTURE_DAMPING,
            iterations,
            undamped=count,
            room=lambda face: actuator_room(face, free, count),
        )
        luma = best.samples[:, 0]
        modes = solve_coefficients(template, luma, observation.weights)
        return TexelFit(replace(face, modes=modes), luma, observation.weights)

    def train(self, crop: Crop, face: FaceParameters) -> None:
        """Use a picture whose face is known for training; does nothing in this class."""

    def eau_precision(self, weights: Single) -> float:
        """Cost of an actuator one unit off its initial value, for texels of `weights` (k,)."""
        return (
            CORRELATED_TEXELS
            * float(weights.mean())
            * (self._residual_sigma_grey / EAU_CHANGE_SIGMA) ** 2
        )

    def _observe(self, target: FitTarget, crop: Crop, initial: FaceParameters) -> Observation:
        luma = self._normalise(crop.picture)
        weights = target.template.weight * self._visible(target.shape.atlas, initial)
        stack = np.asarray(cv2.merge([luma, *image_gradients(luma)]), np.float32)
        precision, hidden = self.eau_precision(weights), None
        if crop.hidden is not None:
            hidden = ~crop.shows(crop.to_crop_px(target.shape.positions(initial)))
            weights = np.where(hidden, np.float32(HIDDEN_WEIGHT) * weights, weights)
        return Observation(target, crop, stack, weights, precision, hidden)

    def _evaluate(
        self, observation: Observation, face: FaceParameters, initial_eau: Array, free: Indices
    ) -> "_TexelEvaluation":
        template, shape = observation.target.template, observation.target.shape
        crop, weights, precision = observation.crop, observation.weights, observation.eau_precision
        texels = shape.project(face)
        samples = sample_bicubic(observation.luma_and_gradients, crop.to_crop_px(texels.pixels))
        if observation.hidden is not None:
            mean = template.mean[observation.hidden]
            samples[observation.hidden] = np.stack([mean, 0 * mean, 0 * mean], 1)
        difference = samples[:, 0] - template.mean
        residual = difference - face.modes.astype(np.float32) @ template.modes
        eau_change = (initial_eau - face.eau)[free]
        scale_grey = self._cauchy_scale_grey
        cost = float(weights @ cauchy_loss(residual, scale_grey))
        cost += precision * float(eau_change @ eau_change)

        def equations() -> Equations:
            root = np.sqrt(weights * cauchy_weights(residual, scale_grey))
            u, v = crop.scale.astype(np.float32)
            gradient = np.stack([samples[:, 1] * (u * root), samples[:, 2] * (v * root)])
            rows = np.concatenate(
                [shape.image_jacobian(texels, gradient, free), template.modes * -root]
            )
            normal = (rows @ rows.T).astype(np.float64)
            # The difference, not the residual: coefficients are solved for as values.
            right = -(rows @ (root * difference)).astype(np.float64)
            eau = np.arange(RIGID, RIGID + len(free))
            normal[eau, eau] += precision
            right[eau] += precision * eau_change
            return normal, right

        return _TexelEvaluation(cost, equations, samples)


@dataclass(frozen=True, slots=True)
class _TexelEvaluation(Evaluation):
    """samples: (k, 3) luma of the texels and its gradients."""

    samples: Single


def every_nth_texel(atlas: Atlas, stride: int) -> Mask:
    """(k,) whether each texel is in every n-th row and column."""
    return np.asarray((atlas.rows % stride == 0) & (atlas.columns % stride == 0))


def solve_coefficients(template: Template, luma: Single, weights: Single) -> Array:
    """(m,) least-squares coefficients of the template's modes; luma, weights: (k,)."""
    modes = template.modes
    if not len(modes):
        return np.zeros(0)
    weighted = modes * weights
    normal = (weighted @ modes.T).astype(np.float64)
    normal[np.diag_indices(len(normal))] *= 1 + 1e-4
    normal[np.diag_indices(len(normal))] += TINY
    right = weighted @ (luma - template.mean)
    return np.asarray(np.linalg.solve(normal, right.astype(np.float64)))


def image_gradients(luma: Single) -> tuple[Single, Single]:
    """Derivatives of luma (h, w) by u and v, grey levels per pixel."""
    u = cv2.Sobel(luma, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    v = cv2.Sobel(luma, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return np.asarray(u, np.float32), np.asarray(v, np.float32)


def cauchy_loss(residual: Single, scale_grey: float = CAUCHY_SCALE_GREY) -> Single:
    """(k,) robust loss, squared grey levels: quadratic for small residuals, logarithmic beyond."""
    square = np.float32(scale_grey**2)
    return np.asarray(square * np.log1p(residual**2 / square))


def cauchy_weights(residual: Single, scale_grey: float = CAUCHY_SCALE_GREY) -> Single:
    """(k,) weights of iteratively reweighted least squares that minimise `cauchy_loss`."""
    return cauchy_weight(residual, np.float32(scale_grey))
