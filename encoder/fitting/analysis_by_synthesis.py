"""Analysis by synthesis (thesis 2.4.3, 4.4): pose, actuators and coefficients that explain a face.

The residual r = g_image - g_model lives in the shape-free frame (eq. 2.22).  Each step solves the
normal equations of eq. 2.27 for pose, actuators and appearance coefficients together; the
derivative of the residual is the picture's own gradient carried along the texels' motion, so it
holds at any pose.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.appearance.texel_visibility import DEPTH_CELL_MM, visible_texels
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.increments import apply_picture_step
from encoder.fitting.levenberg_marquardt import Damping, Evaluation, levenberg_marquardt
from encoder.runtime.image_ops import sample_bicubic
from shared_model.animate import Face
from shared_model.appearance import Atlas
from shared_model.mesh import Head
from shared_model.parameters import EAUS, FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]
Indices = NDArray[np.intp]

# Standard deviation of an actuator about its initial estimate, which comes from the frame before or
# from landmarks.
EAU_CHANGE_SIGMA = 0.25
# Of the residual of a texture that was sampled in the same call, grey levels; the Cauchy scale,
# beyond which a texel counts as an outlier (a hand, a highlight).
RESIDUAL_SIGMA_GREY, CAUCHY_SCALE_GREY = 6.0, 25.0
# Where fits leave less, outliers begin at so many standard deviations of it (Cauchy's usual
# constant); a picture is never taken to be better than this.
CAUCHY_SCALE_SIGMAS = 2.4
MIN_RESIDUAL_SIGMA_GREY = 2.0
# Keeps equations solvable that no texel takes part in.
TINY = 1e-9
# Fits start near their solution: steps are undamped until one raises the cost.
PICTURE_DAMPING = Damping(
    initial=0.0,
    least_after_increase=0.1,
    decrease=10.0,
    relative_ridge=1e-6,
    absolute_ridge=TINY,
)
# Neighbouring texels err together; this many texels count as one.
CORRELATED_TEXELS = 10.0
# Texels that a fit looks at.
NOMINAL_TEXELS = 5000


@dataclass(frozen=True, slots=True)
class FitTarget:
    """What to fit: the texels' places, and what they should look like."""

    shape: ShapeFreeFrame
    template: Template


@dataclass(frozen=True, slots=True)
class Observation:
    """A picture to explain.

    stack: (h, w, 3) the crop's luma and its gradients, grey levels per pixel of the crop.
    shown: (k,) the texels' weights, 0 where they are not seen.  precision: see `Refiner`.
    """

    target: FitTarget
    crop: Crop
    luma_and_gradients: Single
    weights: Single
    eau_precision: float


@dataclass(frozen=True, slots=True)
class TexelFit:
    """A fit: the face with its coefficients; luma (k,) and weight (k,) of the texels seen."""

    face: FaceParameters
    luma: Single
    weights: Single


class TexelFitter:
    """Fits one caller's textured model to pictures, at about `TEXELS` of its texels.

    shape: all texels.  template: what they should look like.
    grey: what of a BGR picture they show.  cell_mm: see `visible_texels`, for all texels.
    """

    def __init__(
        self,
        head: Head,
        face: Face,
        shape: ShapeFreeFrame,
        template: Template,
        normalise: Callable[[Picture], Single] = luma_f32,
        cell_mm: float = DEPTH_CELL_MM,
    ) -> None:
        self._head, self._face, self._normalise = head, face, normalise
        stride = max(1, round(np.sqrt(len(shape) / NOMINAL_TEXELS)))
        atlas = shape.atlas
        self._residual_sigma_grey, self._cauchy_scale_grey = RESIDUAL_SIGMA_GREY, CAUCHY_SCALE_GREY
        self._sampled = kept = (atlas.rows % stride == 0) & (atlas.columns % stride == 0)
        thin = Atlas(
            atlas.size,
            atlas.rows[kept],
            atlas.columns[kept],
            atlas.corners[kept],
            atlas.weights[kept],
        )
        self._cell_mm = cell_mm * stride
        self.shape = ShapeFreeFrame(face, thin, shape.camera)
        self.template = Template(
            template.mean[kept], template.modes[:, kept], template.weight[kept]
        )

    def with_mode(self, mode: Single) -> Self:
        """A copy whose template has one more mode, luma (k,) of all texels."""
        fitter, template = copy(self), self.template
        modes = np.concatenate([template.modes, mode[None, self._sampled]])
        fitter.template = replace(template, modes=modes)
        return fitter

    def set_noise_level(self, residual_sigma_grey: float) -> None:
        """Fits leave so much, a standard deviation: the less, the sooner a motion is evident."""
        least = max(residual_sigma_grey, MIN_RESIDUAL_SIGMA_GREY)
        self._residual_sigma_grey = min(least, RESIDUAL_SIGMA_GREY)
        self._cauchy_scale_grey = min(CAUCHY_SCALE_SIGMAS * least, CAUCHY_SCALE_GREY)

    def visible(self, face: FaceParameters) -> NDArray[np.bool_]:
        """(k,) which texels the camera sees."""
        return self._visible(self.shape.atlas, face)

    def _visible(self, atlas: Atlas, face: FaceParameters) -> NDArray[np.bool_]:
        vertices = self._face.animate(face.eau)
        return visible_texels(self._head, atlas, face.pose, vertices, self._cell_mm)

    def fit_crop(
        self,
        crop: Crop,
        start: FaceParameters,
        iterations: int,
        active: Sequence[int] = range(len(EAUS)),
    ) -> FaceParameters:
        """The face near `start` that the template explains best, with its coefficients.

        active: the actuators that may move; the others stay where `start` has them.
        """
        return self.fit(self.observe(crop, start), start, iterations, active).face

    def observe(self, crop: Crop, initial: FaceParameters) -> "Observation":
        """What a picture shows of a face about like `near`: what fits start from."""
        return self._observe(FitTarget(self.shape, self.template), crop, initial)

    def fit(
        self,
        observation: "Observation",
        start: FaceParameters,
        iterations: int,
        active: Sequence[int],
    ) -> TexelFit:
        """See `refine`; coefficients are sought from `start.modes` on, if it has as many."""
        template, free = observation.target.template, np.asarray(active, np.intp)
        modes = len(template.modes)
        light = start.modes if len(start.modes) == modes else np.zeros(modes)
        face, best = levenberg_marquardt(
            lambda face: self._attempt(observation, face, start.eau, free),
            replace(start, modes=light),
            lambda face, step: apply_picture_step(face, step, free),
            PICTURE_DAMPING,
            iterations,
            undamped=modes,
        )
        grey = best.seen[:, 0]
        modes_found = solve_coefficients(template, grey, observation.weights)
        return TexelFit(replace(face, modes=modes_found), grey, observation.weights)

    def train(self, crop: Crop, face: FaceParameters) -> None:
        """Take notice of a picture whose face is known; derivatives of each picture need none."""

    def eau_precision(self, weights: Single) -> float:
        """What an actuator one unit off its first guess costs, `shown` (k,) being the weights."""
        return (
            CORRELATED_TEXELS
            * float(weights.mean())
            * (self._residual_sigma_grey / EAU_CHANGE_SIGMA) ** 2
        )

    def _observe(self, target: FitTarget, crop: Crop, initial: FaceParameters) -> "Observation":
        grey = self._normalise(crop.picture)
        shown = target.template.weight * self._visible(target.shape.atlas, initial)
        stack = np.asarray(cv2.merge([grey, *image_gradients(grey)]), np.float32)
        return Observation(target, crop, stack, shown, self.eau_precision(shown))

    def _attempt(
        self, view: "Observation", face: FaceParameters, expected_eau: Array, free: Indices
    ) -> "_TexelEvaluation":
        template, shape = view.target.template, view.target.shape
        placed = shape.project(face)
        seen = sample_bicubic(view.luma_and_gradients, view.crop.to_crop_px(placed.pixels))
        residual = seen[:, 0] - template.mean
        left = residual - face.modes.astype(np.float32) @ template.modes
        away = (expected_eau - face.eau)[free]
        scale = self._cauchy_scale_grey
        cost = float(view.weights @ cauchy_loss(left, scale))
        cost += view.eau_precision * float(away @ away)

        def equations() -> tuple[Array, Array]:
            root = np.sqrt(view.weights * cauchy_weights(left, scale))
            across, down = view.crop.scale.astype(np.float32)
            slope = np.stack([seen[:, 1] * (across * root), seen[:, 2] * (down * root)])
            rows = np.concatenate(
                [shape.image_jacobian(placed, slope, free), template.modes * -root]
            )
            normal = (rows @ rows.T).astype(np.float64)
            gradient = -(rows @ (root * residual)).astype(np.float64)
            eau = np.arange(6, 6 + len(free))
            normal[eau, eau] += view.eau_precision
            gradient[eau] += view.eau_precision * away
            return normal, gradient

        return _TexelEvaluation(cost, equations, seen)


@dataclass(frozen=True, slots=True)
class _TexelEvaluation(Evaluation):
    """With the texels' luma and its gradient (k, 3)."""

    seen: Single


def solve_coefficients(template: Template, grey: Single, weight: Single) -> Array:
    """(m,) least-squares coefficients of the template's modes; grey, weight: (k,)."""
    modes = template.modes
    if not len(modes):
        return np.zeros(0)
    weighted = modes * weight
    normal = (weighted @ modes.T).astype(np.float64)
    normal[np.diag_indices(len(normal))] *= 1 + 1e-4
    normal[np.diag_indices(len(normal))] += TINY
    right = weighted @ (grey - template.mean)
    return np.asarray(np.linalg.solve(normal, right.astype(np.float64)))


def image_gradients(grey: Single) -> tuple[Single, Single]:
    """d grey / du and d grey / dv, grey levels per pixel."""
    u = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    v = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return np.asarray(u, np.float32), np.asarray(v, np.float32)


def cauchy_loss(residual: Single, scale_grey: float = CAUCHY_SCALE_GREY) -> Single:
    """Squared grey levels (k,), of outliers only their logarithm: what `robust` minimises."""
    square = np.float32(scale_grey**2)
    return np.asarray(square * np.log1p(residual**2 / square))


def cauchy_weights(residual: Single, scale_grey: float = CAUCHY_SCALE_GREY) -> Single:
    """Cauchy weights (k,)."""
    return np.asarray(1 / (1 + (residual / np.float32(scale_grey)) ** 2))
