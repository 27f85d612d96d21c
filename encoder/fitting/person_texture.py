"""The caller's own textured model, as the tracker fits it: one texture under changing light."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
from encoder.runtime.image_ops import sample_bicubic
from shared_model.animate import Face
from shared_model.appearance import atlas_of
from shared_model.geometry import Camera
from shared_model.mesh import PARTS, Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# Texels a side, coarse to fine.
MAX_ATLAS_SIZES = (56, 192)
# Eyes look about and blink without the actuators that are followed.
EYE_WEIGHT = 0.3
# Share of a new frame in the texture where the first frame did not show it.
FILL_GAIN = 0.2
UPDATE_INTERVAL = 4
# Frames that explain the texture this well may fill what it lacks.
GOOD_CORRELATION = 0.8
# Share of a new fit in what fits are expected to leave.
NOISE_GAIN = 0.1
# Standard deviations of Gaussian noise to the median of its size.
MEDIAN_TO_SIGMA = 1.4826
# Keeps correlations finite where nothing is left to correlate, grey levels to the fourth.
TINY = 1e-18
# One texel in so many is enough for it.
MEDIAN_EVERY = 4


@dataclass(frozen=True, slots=True)
class FitOptions:
    """How the textured model is fitted: to what of a picture, and by which steps."""

    normalise: Normalisation = luma_f32
    fitter: type[TexelFitter] = TexelFitter


DEFAULT_OPTIONS = FitOptions()


class PersonTexture:
    """Texture of one caller, fitted to pictures with gain, offset and a slope of light.

    Pictures are (h, w, 3) uint8 BGR or, which saves time, (h, w) `luma_u8`.

    face: the caller's shape.  frame, start: the picture that shows the texture.
    largest_atlas: texels a side, at most.
    """

    def __init__(
        self,
        head: Head,
        face: Face,
        camera: Camera,
        frame: Picture,
        start: FaceParameters,
        largest_atlas: int,
        options: FitOptions = DEFAULT_OPTIONS,
    ) -> None:
        rest = face.animate(start.eau)
        size = atlas_size_for(atlas_of(head, 64), camera, start.pose, rest, largest_atlas)
        atlas = atlas_of(head, size)
        self._head, self._atlas, self._synthesis = head, atlas, options
        self._grey = options.normalise
        self._ratio = pixels_per_texel(atlas, camera, start.pose, rest)
        self._refiner = self._blank_refiner(face, camera)
        thin = self._refiner.shape.atlas
        self._outline = np.flatnonzero(head.opacity[thin.corners].min(1) > 0.5)
        self._worth = face_mask(head, thin) * _part_weight(head.parts[thin.corners[:, 0]])
        across = 2 * thin.columns.astype(np.float32) / size - 1
        along = 2 * thin.rows.astype(np.float32) / size - 1
        self._light = np.stack([np.ones_like(across), across, along])
        self._lit = np.zeros(4)
        self._learned = 0
        self._noise_grey = RESIDUAL_SIGMA_GREY
        self._first_crop = crop = self._crop(frame, start)
        self._mean = self._sampled(crop, start)
        self._known = self._refiner.visible(start) & (self._worth > 0)
        self._rebuild()
        self._refiner.train(crop, replace(start, modes=self._lit))

    def _blank_refiner(self, face: Face, camera: Camera) -> TexelFitter:
        count, synthesis = len(self._atlas.rows), self._synthesis
        blank = np.zeros(count, np.float32)
        empty = Template(blank, np.zeros((0, count), np.float32), blank)
        shape = ShapeFreeFrame(face, self._atlas, camera)
        return synthesis.fitter(self._head, face, shape, empty, synthesis.normalise)

    def set_shape(self, face: Face, camera: Camera, start: FaceParameters) -> None:
        """Fit the same texture on another shape.  start: its face in the first picture."""
        template = self._refiner.template
        self._refiner = self._blank_refiner(face, camera)
        self._refiner.template = template
        self._refiner.set_noise_level(self._noise_grey)
        self._refiner.train(self._first_crop, replace(start, modes=np.zeros(4)))

    @property
    def observed_texel_count(self) -> int:
        """How many texels some frame has shown."""
        return int(self._known.sum())

    def observe(self, frame: Picture, initial: FaceParameters) -> Observation:
        """What a frame shows of a face about like `near`: what fits start from."""
        return self._refiner.observe(self._crop(frame, initial), initial)

    def fit(
        self,
        observation: Observation,
        start: FaceParameters,
        active: Sequence[int],
        iterations: int,
    ) -> TextureFit:
        """The face near `start` that explains what is seen best; `active` actuators may move."""
        found = self._refiner.fit(observation, replace(start, modes=self._lit), iterations, active)
        seen = found.weights > 0
        if not seen.any():
            return TextureFit(found.face, 0.0, np.inf, RESIDUAL_SIGMA_GREY)
        left = self._left(found)[seen]
        left_grey2 = float(np.average(cauchy_loss(left), weights=found.weights[seen]))
        noise_grey = MEDIAN_TO_SIGMA * float(np.median(np.abs(left[::MEDIAN_EVERY])))
        return TextureFit(found.face, self._correlation(found.luma, seen), left_grey2, noise_grey)

    def update_noise_level(self, fit: TextureFit) -> None:
        """Expect coming fits to leave about as much as this one."""
        self._noise_grey += NOISE_GAIN * (fit.residual_sigma_grey - self._noise_grey)
        self._refiner.set_noise_level(self._noise_grey)

    def _left(self, found: TexelFit) -> Single:
        """(k,) grey levels that a fit leaves unexplained."""
        template = self._refiner.template
        return found.luma - template.mean - found.face.modes.astype(np.float32) @ template.modes

    def update_template(self, frame: Picture, fit: TextureFit) -> None:
        """Keep the light of a frame, and of one in a few what the first did not show."""
        self._lit = fit.face.modes
        self._learned += 1
        if fit.correlation > GOOD_CORRELATION and self._learned % UPDATE_INTERVAL == 0:
            crop = self._crop(frame, fit.face)
            texels = self._sampled(crop, fit.face)
            self._fill(texels, self._refiner.visible(fit.face), fit.face.modes)
            self._refiner.train(crop, fit.face)

    def _fill(self, texels: Single, seen: NDArray[np.bool_], coefficients: Array) -> None:
        """Take from a frame what the first one did not show, as the first one's light had it."""
        new = seen & ~self._first & (self._worth > 0)
        if not new.any():
            return
        light = coefficients.astype(np.float32)
        gain = max(1 + float(light[0]), 0.2)
        before = (texels - light[1:] @ self._light + light[0] * self._centre) / gain
        share = np.where(self._known, np.float32(FILL_GAIN), np.float32(1))
        self._mean[new] += share[new] * (before[new] - self._mean[new])
        self._known |= new
        self._rebuild(first=self._first)

    def _rebuild(self, first: NDArray[np.bool_] | None = None) -> None:
        """Make the template of what is known."""
        self._first = self._known.copy() if first is None else first
        self._centre = (
            np.float32(self._mean[self._known].mean()) if self._known.any() else np.float32(0)
        )
        modes = np.concatenate([(self._mean - self._centre)[None], self._light])
        weight = self._worth * self._known
        self._refiner.template = Template(self._mean, modes.astype(np.float32), weight)

    def _correlation(self, texels: Single, seen: NDArray[np.bool_]) -> float:
        """Correlation of texels and texture, low-order light taken from both."""
        kept = seen & self._known
        if kept.sum() < 50:
            return 0.0
        rows = np.stack([*self._light, texels, self._mean]).astype(np.float64)
        products = (rows * (self._worth * kept)) @ rows.T
        light, across = products[:3, :3], products[:3, 3:]
        rest = products[3:, 3:] - across.T @ np.linalg.lstsq(light, across, rcond=None)[0]
        return float(rest[0, 1] / np.sqrt(max(rest[0, 0] * rest[1, 1], TINY)))

    def _sampled(self, crop: Crop, face: FaceParameters) -> Single:
        at = crop.to_crop_px(self._refiner.shape.positions(face))
        return np.asarray(sample_bicubic(self._grey(crop.picture), at)[:, 0], np.float32)

    def _crop(self, frame: Picture, face: FaceParameters) -> Crop:
        # By coordinates: so the positions are in memory.
        shown = self._refiner.shape.positions(face).T.take(self._outline, axis=1)
        corners = np.stack([shown.min(1), shown.max(1)]).astype(np.float64)
        border = np.array(frame.shape[1::-1]) - 1.0
        return crop_face(frame, np.clip(corners, 0, border), self._ratio)


def _part_weight(parts: NDArray[np.uint8]) -> Single:
    """(k,) 1 on skin, less on eyes, nothing within the mouth."""
    table = np.zeros(len(PARTS), np.float32)
    table[PARTS.index("skin")] = 1
    table[[PARTS.index("eye_left"), PARTS.index("eye_right")]] = EYE_WEIGHT
    return np.asarray(table[parts])
