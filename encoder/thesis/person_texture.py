"""The textured model of one person that the tracker fits: one texture, changing illumination."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from encoder.appearance.masks import face_mask
from encoder.appearance.photometric import Normalisation
from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.appearance.texture import atlas_size_for, pixels_per_texel
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop, crop_face
from encoder.fitting.analysis_by_synthesis import (
    RESIDUAL_SIGMA_GREY,
    Observation,
    TexelFit,
    TexelFitter,
    cauchy_loss,
)
from encoder.fitting.fit_results import TextureFit
from runtime.image_ops import sample_bicubic
from shared_model.animate import Face
from shared_model.appearance import atlas_of
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.geometry import Camera
from shared_model.mesh import PARTS, Head
from shared_model.parameters import FaceParameters

# Texels a side, coarse to fine.
MAX_ATLAS_SIZES = (56, 192)
# Weight of the eyes, whose gaze and blinks the tracked actuators do not explain.
EYE_WEIGHT = 0.3
# Weight of a new frame in texels that the first frame did not show.
UPDATE_GAIN = 0.2
# Frames between updates of the texture, and the least correlation of a frame that updates it.
UPDATE_INTERVAL = 4
GOOD_CORRELATION = 0.8
# Weight of a new fit in the noise level.
NOISE_GAIN = 0.1
# Standard deviation of Gaussian noise over the median of its absolute value.
MEDIAN_TO_SIGMA = 1.4826
# One texel in so many enters the median.
MEDIAN_STRIDE = 4
# Correlations over fewer texels are taken to be 0.
MIN_CORRELATED_TEXELS = 50
# The same of texels with less contrast, standard deviation, grey levels: it would be rounding.
MIN_CONTRAST_GREY = 0.1
# Least gain of an illumination.
MIN_GAIN = 0.2


class PersonTexture:
    """The texture of one person, fitted to pictures with gain, offset and slopes of illumination.

    Pictures are (h, w, 3) uint8 BGR, or faster (h, w) from `luma_u8`.

    face: the person's shape.  frame, start: the first frame, which shows the texture, and its face.
    max_atlas_size: texels a side, at most.
    normalise: takes a BGR picture to the values that are compared.  fitter: how steps are computed.
    """

    def __init__(
        self,
        head: Head,
        face: Face,
        camera: Camera,
        frame: Picture,
        start: FaceParameters,
        max_atlas_size: int,
        normalise: Normalisation = luma_f32,
        fitter: type[TexelFitter] = TexelFitter,
    ) -> None:
        vertices = face.animate(start.eau)
        size = atlas_size_for(atlas_of(head, 64), camera, start.pose, vertices, max_atlas_size)
        atlas = atlas_of(head, size)
        self._head, self._atlas = head, atlas
        self._normalise, self._fitter_type = normalise, fitter
        self._pixels_per_texel = pixels_per_texel(atlas, camera, start.pose, vertices)
        self._fitter = self._empty_fitter(face, camera)
        texels = self._fitter.shape.atlas
        self._outline = np.flatnonzero(head.opacity[texels.corners].min(1) > 0.5)
        part = head.parts[texels.corners[:, 0]]
        self._texel_weight = face_mask(head, texels) * _part_weight(part)
        u = 2 * texels.columns.astype(np.float32) / size - 1
        v = 2 * texels.rows.astype(np.float32) / size - 1
        self._illumination_basis = np.stack([np.ones_like(u), u, v])
        self._illumination = np.zeros(4)
        self._update_count = 0
        self._residual_sigma_grey = RESIDUAL_SIGMA_GREY
        self._first_crop = crop = self._crop(frame, start)
        self._mean = self._sample(crop, start)
        # Texels of the first frame are never updated: the texture stays aligned with its face.
        self._first_observed = self._fitter.visible(start) & (self._texel_weight > 0)
        self._observed = self._first_observed.copy()
        self._rebuild_template()
        self._fitter.train(crop, replace(start, modes=self._illumination))

    def _empty_fitter(self, face: Face, camera: Camera) -> TexelFitter:
        count = len(self._atlas.rows)
        zeros = np.zeros(count, np.float32)
        empty = Template(zeros, np.zeros((0, count), np.float32), zeros)
        shape = ShapeFreeFrame(face, self._atlas, camera)
        return self._fitter_type(face, shape, empty, self._normalise)

    def set_shape(self, face: Face, camera: Camera, start: FaceParameters) -> None:
        """Fit the same texture on another shape.  start: the face in the first frame."""
        template = self._fitter.template
        self._fitter = self._empty_fitter(face, camera)
        self._fitter.template = template
        self._fitter.set_noise_level(self._residual_sigma_grey)
        self._fitter.train(self._first_crop, replace(start, modes=np.zeros(4)))

    def observe(self, frame: Picture, initial: FaceParameters) -> Observation:
        """Prepare a frame for fits near `initial`, see `TexelFitter.observe`."""
        return self._fitter.observe(self._crop(frame, initial), initial)

    def fit(
        self,
        observation: Observation,
        start: FaceParameters,
        active: Sequence[int],
        iterations: int,
    ) -> TextureFit:
        """Fit pose and `active` actuators from `start`, see `TexelFitter.fit`."""
        initial = replace(start, modes=self._illumination)
        fit = self._fitter.fit(observation, initial, iterations, active)
        visible = fit.weights > 0
        if not visible.any():
            return TextureFit(fit.face, 0.0, np.inf, RESIDUAL_SIGMA_GREY)
        residual = self._residual(fit)[visible]
        mse_grey2 = float(np.average(cauchy_loss(residual), weights=fit.weights[visible]))
        sigma_grey = MEDIAN_TO_SIGMA * float(np.median(np.abs(residual[::MEDIAN_STRIDE])))
        return TextureFit(fit.face, self._correlation(fit.luma, visible), mse_grey2, sigma_grey)

    def update_noise_level(self, fit: TextureFit) -> None:
        """Update the noise level of later fits by the residual of this one."""
        self._residual_sigma_grey += NOISE_GAIN * (
            fit.residual_sigma_grey - self._residual_sigma_grey
        )
        self._fitter.set_noise_level(self._residual_sigma_grey)

    def _residual(self, fit: TexelFit) -> Single:
        """(k,) residual, grey levels."""
        template = self._fitter.template
        return fit.luma - template.mean - fit.face.modes.astype(np.float32) @ template.modes

    def update_template(self, frame: Picture, fit: TextureFit) -> None:
        """Start later fits at the frame's illumination; at intervals, update unseen texels."""
        self._illumination = fit.face.modes
        self._update_count += 1
        if fit.correlation > GOOD_CORRELATION and self._update_count % UPDATE_INTERVAL == 0:
            crop = self._crop(frame, fit.face)
            texels = self._sample(crop, fit.face)
            self._fill_unseen(texels, self._fitter.visible(fit.face), fit.face.modes)
            self._fitter.train(crop, fit.face)

    def _fill_unseen(self, texels: Single, visible: Mask, coefficients: Array) -> None:
        """Update texels that the first frame did not show, in the first frame's illumination."""
        chosen = visible & ~self._first_observed & (self._texel_weight > 0)
        if not chosen.any():
            return
        light = coefficients.astype(np.float32)
        gain = max(1 + float(light[0]), MIN_GAIN)
        relit = (texels - light[1:] @ self._illumination_basis + light[0] * self._centre) / gain
        share = np.where(self._observed, np.float32(UPDATE_GAIN), np.float32(1))
        # A copy: templates in use, also by a bundle adjustment in the background, hold the old one.
        self._mean = self._mean.copy()
        self._mean[chosen] += share[chosen] * (relit[chosen] - self._mean[chosen])
        self._observed |= chosen
        self._rebuild_template()

    def _rebuild_template(self) -> None:
        observed = self._observed
        self._centre = np.float32(self._mean[observed].mean()) if observed.any() else np.float32(0)
        modes = np.concatenate([(self._mean - self._centre)[None], self._illumination_basis])
        weight = self._texel_weight * observed
        self._fitter.template = Template(self._mean, modes.astype(np.float32), weight)

    def _correlation(self, texels: Single, visible: Mask) -> float:
        """Correlation of texels and texture, low-order light removed from both."""
        chosen = visible & self._observed
        if chosen.sum() < MIN_CORRELATED_TEXELS:
            return 0.0
        rows = np.stack([*self._illumination_basis, texels, self._mean]).astype(np.float64)
        products = (rows * (self._texel_weight * chosen)) @ rows.T
        light, mixed = products[:3, :3], products[:3, 3:]
        rest = products[3:, 3:] - mixed.T @ np.linalg.lstsq(light, mixed, rcond=None)[0]
        least = MIN_CONTRAST_GREY**2 * float(self._texel_weight[chosen].sum())
        if min(rest[0, 0], rest[1, 1]) < least:
            return 0.0
        return float(rest[0, 1] / np.sqrt(rest[0, 0] * rest[1, 1]))

    def _sample(self, crop: Crop, face: FaceParameters) -> Single:
        positions = crop.to_crop_px(self._fitter.shape.positions(face))
        values = self._normalise(crop.picture)
        return np.asarray(sample_bicubic(values, positions)[:, 0], np.float32)

    def _crop(self, frame: Picture, face: FaceParameters) -> Crop:
        # Transposed: positions are stored coordinate by coordinate.
        outline = self._fitter.shape.positions(face).T.take(self._outline, axis=1)
        corners = np.stack([outline.min(1), outline.max(1)]).astype(np.float64)
        border = np.array(frame.shape[1::-1]) - 1.0
        return crop_face(frame, np.clip(corners, 0, border), self._pixels_per_texel)


def _part_weight(parts: Picture) -> Single:
    """(k,) 1 on skin, less on eyes, 0 inside the mouth."""
    table = np.zeros(len(PARTS), np.float32)
    table[PARTS.index("skin")] = 1
    table[[PARTS.index("eye_left"), PARTS.index("eye_right")]] = EYE_WEIGHT
    return np.asarray(table[parts])
