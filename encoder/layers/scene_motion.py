"""The motion of the scene where the camera moves: fitted to coarse pictures, coarse to fine."""

from functools import lru_cache, partial

import cv2
import numpy as np

from encoder.fitting.gauss_newton import Equations, gauss_newton
from encoder.layers.displacement import dot, moved_back, pixel_grid, sample
from runtime.cauchy_weight import cauchy_weight
from runtime.image_ops import blurred
from shared_model.arrays import Array, Single
from shared_model.layers.scene_motion import displacement_basis

# A blurred picture (h, w) and its gradient (h, w, 2), half as large and whole.
ScenePyramid = tuple[tuple[Single, Single], ...]

# Of pictures half as large and of whole ones: standard deviations, pixels, of the kernels by which
# they are blurred, and Gauss-Newton steps at each.
HALF_SIGMA, WHOLE_SIGMA, STEPS = 2.0, 1.5, 3
# The scene moves if that leaves at most this share of the squared residual behind the person, of
# which a pixel counts at most so many squared grey levels.
MAX_LEFT, MAX_GREY2 = 0.6, 400.0
# Of the normal matrix' diagonal; and its least value, squared grey levels per pixel.
RELATIVE_RIDGE, RIDGE_GREY2 = 1e-3, 1e-3


@lru_cache(maxsize=8)
def scene_basis(shape: tuple[int, int]) -> Single:
    """(4, h, w, 2) pixels of a picture of `shape`, see `displacement_basis`; read only."""
    grid = pixel_grid(shape).astype(np.float64)
    basis = displacement_basis(shape[1], shape[0], grid).astype(np.float32)
    basis.flags.writeable = False
    return basis


def scene_origins(basis: Single, motion: Array) -> Single:
    """(h, w, 2) where each pixel of a frame comes from in the picture of the scene."""
    grid = pixel_grid((basis.shape[1], basis.shape[2]))
    return moved_back(grid, motion, basis)


def scene_pyramid(scene: Single) -> ScenePyramid:
    """A scene (h, w) as `fit_scene_motion` takes it."""
    return tuple((picture, gradient(picture)) for picture in _blurred_pictures(scene))


def _blurred_pictures(image: Single) -> tuple[Single, Single]:
    """An image (h, w), half as large and whole."""
    return blurred(halved(image), HALF_SIGMA), blurred(image, WHOLE_SIGMA)


def fit_scene_motion(scene: ScenePyramid, luma: Single, weight: Single) -> Array:
    """(4,) how the scene moves in a frame.  luma, weight: (h, w) of the frame."""
    motion = np.zeros(4)
    levels = zip(scene, _blurred_pictures(luma), (halved(weight), weight), strict=True)
    for (picture, slope), target, counted in levels:
        equations = partial(_equations, picture, slope, target, counted)
        motion = gauss_newton(equations, motion, np.add, STEPS)
    return motion


def _equations(
    scene: Single, slope: Single, target: Single, weight: Single, motion: Array
) -> Equations:
    """scene, slope: a picture (h, w) and its gradient (h, w, 2).  target, weight: (h, w)."""
    basis = scene_basis((target.shape[0], target.shape[1]))
    at = scene_origins(basis, motion)
    residual = np.asarray(target - sample(scene, at), np.float32)
    trust = cauchy_weight(residual, weight=weight)
    jacobian = -dot(basis, sample(slope, at))
    return coarse_equations(jacobian, residual, trust)


def coarse_equations(jacobian: Single, residual: Single, weight: Single) -> Equations:
    """The normal equations of a coarse picture's residual, with a ridge.

    jacobian: (k, h, w) of what is drawn.  residual, weight: (h, w).
    """
    rows = jacobian.reshape(len(jacobian), -1)
    weighted = rows * weight.ravel()
    normal = (weighted @ rows.T).astype(np.float64)
    ridge = RELATIVE_RIDGE * np.diag(normal) + RIDGE_GREY2 * rows.shape[1]
    return normal + np.diag(ridge), weighted @ residual.ravel()


def is_explained(moving: float, still: float) -> bool:
    """Whether the scene moves: by the `residual_energy` with its motion, and that without."""
    return moving < MAX_LEFT * still


def residual_energy(luma: Single, drawn: Single, weight: Single) -> float:
    """The weighted squared difference of a frame (h, w) and what was drawn.  weight: (h, w)."""
    return float((np.minimum((luma - drawn) ** 2, MAX_GREY2) * weight).sum())


def halved(image: Single) -> Single:
    """An image (h, w) or (h, w, c) half as large in each direction."""
    size = -(-image.shape[1] // 2), -(-image.shape[0] // 2)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


def gradient(image: Single) -> Single:
    """(h, w, 2) central differences."""
    across = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3) / 8
    down = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3) / 8
    return np.stack([across, down], -1).astype(np.float32)
