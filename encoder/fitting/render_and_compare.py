"""Analysis by synthesis in the picture (render and compare): the last step of a fit.

`analysis_by_synthesis` compares texels: it is fast and converges from far.  A receiver sees pixels:
where a surface is foreshortened many texels share one pixel, neighbours across an outline belong to
different surfaces, and a rendered texture has been interpolated.  Here the pixels of the face are
rendered as by a decoder, and their squared error is minimised.
"""

from copy import copy
from dataclasses import dataclass, replace

import cv2
import numpy as np

from encoder.appearance.rasteriser import Fragments, rasterise
from encoder.appearance.shape_free import directional_jacobian, rigid_jacobian
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import (
    HIDDEN_WEIGHT,
    PICTURE_DAMPING,
    cauchy_weights,
    image_gradients,
)
from encoder.fitting.gauss_newton import (
    Equations,
    Evaluation,
    damped_step,
    levenberg_marquardt,
)
from encoder.fitting.increments import (
    FACE_PARAMETERS,
    RIGID,
    actuator_room,
    apply_picture_step,
)
from runtime.bilinear import bilinear_weights
from runtime.image_ops import hull_mask
from runtime.jit import jit
from shared_model.animate import Face
from shared_model.arrays import Array, Indices, Mask, Single
from shared_model.geometry import Camera, matrix_from_quaternion
from shared_model.parameters import EAUS, LID_EAUS, FaceParameters

# Pixels of the face that are compared, at most; half as many cost .07 dB.
MAX_PIXELS = 6000
# Cost of an actuator one unit off its initial value, squared grey levels.  Lids hardly move: a lid
# that is half closed may raise PSNR, but viewers notice it.
EAU_CHANGE_COST_GREY2 = np.array([400.0 if eau.name in LID_EAUS else 6.0 for eau in EAUS])
ITERATIONS = 1
# Pixels in which the face is less opaque than this are not compared.
MIN_OPACITY = 0.5
# A face that covers less than this share of the pixels has infinite cost.
MIN_VISIBLE_SHARE = 0.5
# Vertices nearer to the camera are rendered at this depth.
MIN_DEPTH_MM = 10.0
# Side of the window in which the error is averaged to detect occlusion, in widths of the face.
OCCLUSION_WINDOW = 0.1
ALL_EAUS = np.arange(len(EAUS))


class ImageFitter:
    """Renders the face of one person in luma, and fits it to pictures.

    mean: (size, size) luma of the texture.  modes: (m, size, size), per unit coefficient.
    max_pixels: compared at most; of a larger face, every n-th one of each row and column.
    """

    def __init__(
        self,
        face: Face,
        camera: Camera,
        mean: Single,
        modes: Single,
        max_pixels: int = MAX_PIXELS,
    ) -> None:
        head, size = face.head, len(mean)
        self._face, self._camera, self._size = face, camera, size
        self._max_pixels = max_pixels
        textures = np.concatenate([mean[None], modes]).reshape(1 + len(modes), -1)
        self._textures = np.ascontiguousarray(textures.T, np.float32)
        self._mean = np.ascontiguousarray(self._textures[:, :1])
        texels = head.texture_coordinates * size - 0.5
        self._vertex_attributes = np.vstack([texels.T, head.opacity]).astype(np.float32)
        fields = np.stack([head.eau_up, -head.eau_down]).swapaxes(-1, -2)
        self._fields = np.ascontiguousarray(fields, np.float32)

    def with_mode(self, mode: Single) -> "ImageFitter":
        """A copy with one more mode, (size, size) luma per unit coefficient."""
        fitter = copy(self)
        fitter._textures = np.column_stack([self._textures, mode.ravel()])
        return fitter

    def fit(
        self, crop: Crop, start: FaceParameters, outline_px: Array, iterations: int = ITERATIONS
    ) -> FaceParameters:
        """The face near `start` of least squared error in the pixels within the outline.

        start: with as many coefficients as there are modes; returned if it is hardly visible.
        outline_px: (n, 2) of the face, pixels of the frame.
        """
        observation = _observe(crop, start, outline_px, self._max_pixels)
        first = self._render(observation, start)
        weights = _occlusion_weights(observation, first)

        def evaluate(face: FaceParameters) -> Evaluation:
            rendering = first if face is start else self._render(observation, face)
            return self._evaluate(observation, rendering, weights[rendering.fragments.pixels])

        result, _ = levenberg_marquardt(
            evaluate,
            start,
            lambda face, step: apply_picture_step(face, step, ALL_EAUS),
            PICTURE_DAMPING,
            iterations,
            undamped=len(start.modes),
            room=lambda face: actuator_room(face, ALL_EAUS, len(start.modes)),
        )
        return result

    def fit_modes(self, crop: Crop, start: FaceParameters, outline_px: Array) -> FaceParameters:
        """The face of `start` with the coefficients of least squared error, sooner found."""
        observation = _observe(crop, start, outline_px, self._max_pixels, is_still=True)
        rendering = self._render(observation, start)
        if not len(rendering.error):
            return start
        weights = _occlusion_weights(observation, rendering)[rendering.fragments.pixels]
        rows = _sample_textures(rendering.texels, self._textures, self._size)[:, 1:]
        equations = _weighted_equations(rows, rendering, weights)
        return replace(start, modes=damped_step(equations, 0.0, PICTURE_DAMPING, len(start.modes)))

    def _render(self, observation: "_Observation", face: FaceParameters) -> "_Rendering":
        rotation = matrix_from_quaternion(face.pose.rotation)
        rotated = self._face.animate(face.eau) @ rotation.T
        vertices = rotated + face.pose.translation_mm
        depth = np.maximum(vertices[:, 2:], MIN_DEPTH_MM)
        frame_px = self._camera.centre + vertices[:, :2] * (self._camera.focal_px / depth)
        points_px = observation.from_frame(frame_px.astype(np.float32)).astype(np.float64)
        triangles = self._face.head.triangles
        fragments = rasterise(points_px, depth[:, 0], triangles, observation.inside)
        attributes = fragments.interpolate(self._vertex_attributes)
        opaque = attributes[2] > MIN_OPACITY
        fragments = fragments.select(opaque)
        texels, opacity = attributes[:2, opaque], attributes[2, opaque]
        values = np.append(1, face.modes).astype(np.float32)
        luma = _combine_textures(texels, self._textures, values, self._size)
        observed = observation.luma[fragments.pixels]
        if observation.hidden is not None:
            mean = _combine_textures(texels, self._mean, values[:1], self._size)
            observed = np.where(observation.hidden[fragments.pixels], mean, observed)
        # Transparent parts are assumed to show the right background.
        error = opacity * (observed - luma)
        return _Rendering(face, rotation, rotated, fragments, texels, opacity, error)

    def _evaluate(
        self, observation: "_Observation", rendering: "_Rendering", weights: Single
    ) -> Evaluation:
        face, error = rendering.face, rendering.error
        eau_change = observation.initial_eau - face.eau
        visible = len(error) > MIN_VISIBLE_SHARE * observation.inside.sum()
        cost = float((weights * error**2).sum() / weights.sum()) if visible else np.inf

        def equations() -> Equations:
            rows = self._jacobian(observation, rendering)
            normal, right = _weighted_equations(rows, rendering, weights)
            eau = np.arange(RIGID, FACE_PARAMETERS)
            precision = EAU_CHANGE_COST_GREY2 * float(weights.sum())
            normal[eau, eau] += precision
            right[eau] += precision * eau_change
            return normal, right

        return Evaluation(cost + float(EAU_CHANGE_COST_GREY2 @ eau_change**2), equations)

    def _jacobian(self, observation: "_Observation", rendering: "_Rendering") -> Single:
        """(p, 6 + EAUs + m) derivatives of the rendered pixels by pose, actuators, coefficients."""
        face, fragments = rendering.face, rendering.fragments
        rotated = fragments.interpolate(rendering.rotated.T.astype(np.float32))
        points = rotated + face.pose.translation_mm.astype(np.float32)[:, None]
        # A pixel changes as if the picture stood still and the point moved the opposite way.
        gradient = -observation.gradients[:, fragments.pixels]
        px_per_mm = np.float32(self._camera.focal_px) / points[2]
        rigid = rigid_jacobian(rotated, points, px_per_mm, gradient)
        head_gradient = rendering.rotation.astype(np.float32).T @ rigid[3:]
        rows = np.empty((len(rendering.error), FACE_PARAMETERS + len(face.modes)), np.float32)
        rows[:, :RIGID] = rigid.T
        rows[:, RIGID:FACE_PARAMETERS] = self._eau_jacobian(fragments, face.eau, head_gradient).T
        textures = _sample_textures(rendering.texels, self._textures, self._size)
        rows[:, FACE_PARAMETERS:] = textures[:, 1:]
        return rows

    def _eau_jacobian(self, fragments: Fragments, eau: Array, gradient: Single) -> Single:
        """(EAUs, p) derivatives by each actuator; gradient: (3, p) per mm, head frame."""
        fields = self._fields[np.where(eau >= 0, 0, 1), ALL_EAUS]
        fields = fragments.interpolate(fields.reshape(-1, fields.shape[-1]))
        fields = fields.reshape(len(ALL_EAUS), 3, -1)
        support = np.tile([0, fields.shape[-1]], (len(ALL_EAUS), 1))
        return directional_jacobian(fields, support, ALL_EAUS, gradient)


@jit
def _sample_textures(texels: Single, textures: Single, size: int) -> Single:
    """(p, m) textures (size * size, m) at texels (2, p), column and row, bilinear."""
    samples = np.empty((texels.shape[1], textures.shape[1]), np.float32)
    for pixel in range(len(samples)):
        first, a, b, c, d = bilinear_weights(texels[0, pixel], texels[1, pixel], size, size)
        for texture in range(textures.shape[1]):
            samples[pixel, texture] = (
                a * textures[first, texture]
                + b * textures[first + 1, texture]
                + c * textures[first + size, texture]
                + d * textures[first + size + 1, texture]
            )
    return samples


@jit
def _combine_textures(texels: Single, textures: Single, values: Single, size: int) -> Single:
    """(p,) `_sample_textures` @ `values` (m,), without the intermediate array."""
    luma = np.empty(texels.shape[1], np.float32)
    for pixel in range(len(luma)):
        first, a, b, c, d = bilinear_weights(texels[0, pixel], texels[1, pixel], size, size)
        total = np.float32(0)
        for texture in range(textures.shape[1]):
            total += values[texture] * (
                a * textures[first, texture]
                + b * textures[first + 1, texture]
                + c * textures[first + size, texture]
                + d * textures[first + size + 1, texture]
            )
        luma[pixel] = total
    return luma


@dataclass(frozen=True, slots=True)
class _Observation:
    """The compared pixels of a crop, every `step`-th of a rectangle (h, w).

    corner: (2,) of the rectangle, crop pixels.  step: crop pixels.
    inside: (h, w) whether a pixel lies within the outline.  luma: (h w,).
    gradients: (2, h w), grey levels per pixel of the frame; (0, h w) if the face does not move.
    initial_eau: (EAUs,).
    hidden: (h w,) pixels that count as if they showed the mean; None: none does.
    """

    crop: Crop
    corner: Indices
    step: int
    inside: Mask
    luma: Single
    gradients: Single
    initial_eau: Array
    hidden: Mask | None = None

    def from_frame(self, positions_px: Single) -> Single:
        """Positions (k, 2) in the frame as columns and rows of the compared pixels."""
        return np.asarray((self.crop.to_crop_px(positions_px) - self.corner) / self.step)


@dataclass(frozen=True, slots=True)
class _Rendering:
    """A rendered face.

    rotation: of its pose.  rotated: (n, 3) vertices, mm, camera axes, before the translation.
    fragments: the p pixels that show it.  texels: (2, p) column and row in the texture.
    opacity: (p,).  error: (p,) grey levels, observed less rendered.
    """

    face: FaceParameters
    rotation: Array
    rotated: Array
    fragments: Fragments
    texels: Single
    opacity: Single
    error: Single


def _weighted_equations(rows: Single, rendering: _Rendering, weights: Single) -> Equations:
    """Normal equations by rows (p, n), which are overwritten; coefficients, the last, as values."""
    root = np.sqrt(weights)
    rows *= (rendering.opacity * root)[:, None]
    normal = (rows.T @ rows).astype(np.float64)
    right = (rows.T @ (root * rendering.error)).astype(np.float64)
    modes = rendering.face.modes
    return normal, right + normal[:, len(normal) - len(modes) :] @ modes


def _observe(
    crop: Crop, start: FaceParameters, outline_px: Array, max_pixels: int, is_still: bool = False
) -> _Observation:
    luma = luma_f32(crop.picture)
    outline = crop.to_crop_px(outline_px.astype(np.float32))
    low = np.maximum(np.floor(outline.min(0)), 0).astype(np.intp)
    high = np.minimum(np.ceil(outline.max(0)) + 1, luma.shape[::-1]).astype(np.intp)
    rows, columns = (slice(low[i], max(low[i], high[i])) for i in (1, 0))
    inside = hull_mask(outline - low, luma[rows, columns].shape) > 0
    step = max(1, int(np.ceil(np.sqrt(inside.sum() / max_pixels))))
    planes = (luma,) if is_still else (luma, *image_gradients(luma))
    sampled = np.stack([plane[rows, columns][::step, ::step].ravel() for plane in planes])
    gradients = sampled[1:] * crop.scale.astype(np.float32)[: len(sampled) - 1, None]
    inside = np.ascontiguousarray(inside[::step, ::step])
    hidden = None
    if crop.hidden is not None:
        hidden = crop.hidden[rows, columns][::step, ::step].ravel()
        gradients[:, hidden] = 0
    return _Observation(crop, low, step, inside, sampled[0], gradients, start.eau, hidden)


def _occlusion_weights(observation: _Observation, rendering: _Rendering) -> Single:
    """(h w,) weights of the pixels: low where the error is large all around, as behind a hand that
    is not known to hide them.

    The error of an outline rendered a pixel off is confined to a thin line, and keeps its weight.
    """
    height, width = observation.inside.shape
    error = np.zeros(height * width, np.float32)
    error[rendering.fragments.pixels] = np.abs(rendering.error)
    side = 2 * round(OCCLUSION_WINDOW * width / 2) + 1
    mean = cv2.blur(error.reshape(height, width), (side, side)) if len(error) else error
    # Squared, since a large occluded area must have no influence.
    weights = cauchy_weights(np.asarray(mean, np.float32).ravel()) ** 2
    if observation.hidden is not None:
        weights[observation.hidden] *= HIDDEN_WEIGHT
    return weights
