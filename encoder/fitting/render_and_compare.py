"""The face that draws best: analysis by synthesis in the picture, the last step of a fit.

`refine` compares texels, which is quick and finds its way from afar.  A receiver sees pixels: where
a surface is foreshortened many texels share one, along outlines neighbours lie on different
surfaces, and what is drawn has been interpolated.  Here the pixels of the face are drawn as a
decoder draws them, and their squared error is made least.
"""

from copy import copy
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.appearance.rasteriser import Fragments, rasterise
from encoder.appearance.shape_free import directional_jacobian, rigid_jacobian
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import PICTURE_DAMPING, cauchy_weights, image_gradients
from encoder.fitting.increments import FACE_PARAMETERS, apply_picture_step
from encoder.fitting.levenberg_marquardt import Evaluation, levenberg_marquardt
from encoder.runtime.image_ops import hull_mask
from encoder.runtime.jit import jit
from shared_model.animate import Face
from shared_model.geometry import Camera, matrix_from_quaternion
from shared_model.parameters import EAUS, LID_EAUS, FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Pixels of the face that are looked at; half as many cost .07 dB.
MAX_PIXELS = 6000
# What an actuator one unit off its first guess costs, squared grey levels.  Lids stay: what PSNR
# gains by a lid that is half closed, people lose.
HELD_GREY2 = np.array([400.0 if eau.name in LID_EAUS else 6.0 for eau in EAUS])
STEPS = 1
# Less of the face's own colour than this in a pixel, and it says little about the face.
LEAST_OPACITY = 0.5
# A face that shows in less than this share of the pixels has gone astray; none is nearer than this.
LEAST_SHOWN = 0.5
NEAREST_MM = 10.0
# The side of what is called all around a pixel, in widths of the face.
WIDE = 0.1
EVERY = np.arange(len(EAUS))


class ImageFitter:
    """Draws one caller's face in luma, and fits it to pictures.

    mean: (size, size) luma of the texture.  modes: (m, size, size), per unit coefficient.
    most_pixels: of a larger face every second, third, ... pixel of each row and column is looked
        at.
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
        self._most_pixels = max_pixels
        layers = np.concatenate([mean[None], modes]).reshape(1 + len(modes), -1)
        self._layers = np.ascontiguousarray(layers.T, np.float32)
        places = head.texture_coordinates * size - 0.5
        self._worn = np.vstack([places.T, head.opacity]).astype(np.float32)
        fields = np.stack([head.eau_up, -head.eau_down]).swapaxes(-1, -2)
        self._fields = np.ascontiguousarray(fields, np.float32)

    def with_mode(self, mode: Single) -> "ImageFitter":
        """The same with one mode more, (size, size) luma per unit coefficient."""
        taught = copy(self)
        taught._layers = np.column_stack([self._layers, mode.ravel()])
        return taught

    def fit(
        self, crop: Crop, start: FaceParameters, outline_px: Array, steps: int = STEPS
    ) -> FaceParameters:
        """The face near `start` whose drawn pixels within the outline are nearest to the crop's.

        start: with as many coefficients as there are modes.  One that does not show stays.
        outline_px: (n, 2) of the face, pixels of the frame.
        """
        view = _view(crop, start, outline_px, self._most_pixels)
        first = self._look(view, start)
        trust = _trust(view, first)

        def attempt(face: FaceParameters) -> Evaluation:
            look = first if face is start else self._look(view, face)
            return self._tried(view, look, trust[look.surface.pixels])

        found, _ = levenberg_marquardt(
            attempt,
            start,
            lambda face, step: apply_picture_step(face, step, EVERY),
            PICTURE_DAMPING,
            steps,
            undamped=len(start.modes),
        )
        return found

    def _look(self, view: "_View", face: FaceParameters) -> "_Look":
        rotation = matrix_from_quaternion(face.pose.rotation)
        turned = self._face.animate(face.eau) @ rotation.T
        seen = turned + face.pose.translation_mm
        depth = np.maximum(seen[:, 2:], NEAREST_MM)
        frame_px = self._camera.centre + seen[:, :2] * (self._camera.focal_px / depth)
        at_px = view.from_frame(frame_px.astype(np.float32)).astype(np.float64)
        surface = rasterise(at_px, depth[:, 0], self._face.head.triangles, view.wanted)
        worn = surface.interpolate(self._worn)
        kept = worn[2] > LEAST_OPACITY
        surface = surface.select(kept)
        places, opacity = worn[:2, kept], worn[2, kept]
        values = np.append(1, face.modes).astype(np.float32)
        drawn = _shaded(places, self._layers, values, self._size)
        # Where the face is not opaque it is taken to cover what is right.
        error = opacity * (view.grey[surface.pixels] - drawn)
        return _Look(face, rotation, turned, surface, places, opacity, error)

    def _tried(self, view: "_View", look: "_Look", trust: Single) -> Evaluation:
        face, surface, error = look.face, look.surface, look.error
        away = view.start.eau - face.eau
        shown = len(error) > LEAST_SHOWN * view.wanted.sum()
        cost = float((trust * error**2).sum() / trust.sum()) if shown else np.inf

        def equations() -> tuple[Array, Array]:
            at = surface.interpolate(look.turned.T.astype(np.float32))
            place = at + face.pose.translation_mm.astype(np.float32)[:, None]
            # What a pixel shows changes as if the picture stood still and the point moved back.
            slope = -view.slopes[:, surface.pixels]
            per_mm = np.float32(self._camera.focal_px) / place[2]
            rigid = rigid_jacobian(at, place, per_mm, slope)
            back = look.rotation.astype(np.float32).T @ rigid[3:]
            rows = np.empty((len(error), FACE_PARAMETERS + len(face.modes)), np.float32)
            rows[:, :6] = rigid.T
            rows[:, 6:FACE_PARAMETERS] = self._eau_jacobian(surface, face.eau, back).T
            rows[:, FACE_PARAMETERS:] = _textured(look.places, self._layers, self._size)[:, 1:]
            root = np.sqrt(trust)
            rows *= (look.opacity * root)[:, None]
            normal = (rows.T @ rows).astype(np.float64)
            gradient = (rows.T @ (root * error)).astype(np.float64)
            # Coefficients are sought themselves, not by how much they change.
            gradient += normal[:, FACE_PARAMETERS:] @ face.modes
            eau, held = np.arange(6, FACE_PARAMETERS), HELD_GREY2 * float(trust.sum())
            normal[eau, eau] += held
            gradient[eau] += held * away
            return normal, gradient

        return Evaluation(cost + float(HELD_GREY2 @ away**2), equations)

    def _eau_jacobian(self, surface: Fragments, eau: Array, gradient: Single) -> Single:
        """(EAUs, p) how each actuator changes the pixels; gradient: (3, p) per mm, head frame."""
        fields = self._fields[np.where(eau >= 0, 0, 1), EVERY]
        fields = surface.interpolate(fields.reshape(-1, fields.shape[-1]))
        fields = fields.reshape(len(EVERY), 3, -1)
        support = np.tile([0, fields.shape[-1]], (len(EVERY), 1))
        return directional_jacobian(fields, support, EVERY, gradient)


@jit
def _textured(places: Single, layers: Single, size: int) -> Single:
    """(p, m) texels (size * size, m) at places (2, p), column and row, bilinear."""
    found = np.empty((places.shape[1], layers.shape[1]), np.float32)
    for pixel in range(len(found)):
        first, a, b, c, d = _corners(places[0, pixel], places[1, pixel], size)
        for layer in range(layers.shape[1]):
            found[pixel, layer] = (
                a * layers[first, layer]
                + b * layers[first + 1, layer]
                + c * layers[first + size, layer]
                + d * layers[first + size + 1, layer]
            )
    return found


@jit
def _shaded(places: Single, layers: Single, values: Single, size: int) -> Single:
    """(p,) the sum of what `_textured` gives, `values` (m,) being how much of each."""
    found = np.empty(places.shape[1], np.float32)
    for pixel in range(len(found)):
        first, a, b, c, d = _corners(places[0, pixel], places[1, pixel], size)
        total = np.float32(0)
        for layer in range(layers.shape[1]):
            total += values[layer] * (
                a * layers[first, layer]
                + b * layers[first + 1, layer]
                + c * layers[first + size, layer]
                + d * layers[first + size + 1, layer]
            )
        found[pixel] = total
    return found


@jit
def _corners(
    u: np.float32, v: np.float32, size: int
) -> tuple[int, np.float32, np.float32, np.float32, np.float32]:
    """The texel up and left of a place, row by row, and the shares in the place of it, of those to
    its right, below, and both."""
    most, least, one = np.float32(size - 1.001), np.float32(0), np.float32(1)
    u, v = np.float32(min(max(u, least), most)), np.float32(min(max(v, least), most))
    column, row = int(u), int(v)
    x, y = u - np.float32(column), v - np.float32(row)
    return row * size + column, (one - x) * (one - y), x * (one - y), (one - x) * y, x * y


@dataclass(frozen=True, slots=True)
class _View:
    """The pixels of a crop that are looked at, as a picture of their own.

    crop: where they are from.  corner: (2,) of the picture in the crop.  step: crop pixels between.
    wanted: (h, w) which of them are the face's.  grey: (h w,).  slopes: (2, h w), grey levels per
    pixel of the frame.  start: the first guess.
    """

    crop: Crop
    corner: NDArray[np.intp]
    step: int
    wanted: NDArray[np.bool_]
    grey: Single
    slopes: Single
    start: FaceParameters

    def from_frame(self, positions_px: Single) -> Single:
        """Positions (k, 2) in the frame to positions among these pixels."""
        return np.asarray((self.crop.to_crop_px(positions_px) - self.corner) / self.step)


@dataclass(frozen=True, slots=True)
class _Look:
    """A face as it would be drawn.

    rotation: of its pose.  turned: (n, 3) vertices, mm, camera axes, before its translation.
    surface: what the pixels show.  places: (2, p) where in the texture, column and row.
    opacity: (p,).  error: (p,) grey levels that the picture is brighter.
    """

    face: FaceParameters
    rotation: Array
    turned: Array
    surface: Fragments
    places: Single
    opacity: Single
    error: Single


def _view(crop: Crop, start: FaceParameters, outline_px: Array, most_pixels: int) -> _View:
    grey = luma_f32(crop.picture)
    outline = crop.to_crop_px(outline_px.astype(np.float32))
    low = np.maximum(np.floor(outline.min(0)), 0).astype(np.intp)
    high = np.minimum(np.ceil(outline.max(0)) + 1, grey.shape[::-1]).astype(np.intp)
    rows, columns = (slice(low[i], max(low[i], high[i])) for i in (1, 0))
    inside = hull_mask(outline - low, grey[rows, columns].shape) > 0
    step = max(1, int(np.ceil(np.sqrt(inside.sum() / most_pixels))))
    thin = (each[rows, columns][::step, ::step].ravel() for each in (grey, *image_gradients(grey)))
    seen, *slopes = thin
    scaled = np.stack(slopes) * crop.scale.astype(np.float32)[:, None]
    wanted = np.ascontiguousarray(inside[::step, ::step])
    return _View(crop, low, step, wanted, seen, scaled, start)


def _trust(view: _View, look: _Look) -> Single:
    """(h w,) how much each pixel counts: less where all around it is far off, behind a hand.

    An edge that is drawn a pixel off is thin, and counts.
    """
    height, width = view.wanted.shape
    away = np.zeros(height * width, np.float32)
    away[look.surface.pixels] = np.abs(look.error)
    side = 2 * round(WIDE * width / 2) + 1
    around = cv2.blur(away.reshape(height, width), (side, side)) if len(away) else away
    # Squared: a large area that is far off must not pull at all.
    return cauchy_weights(np.asarray(around, np.float32).ravel()) ** 2
