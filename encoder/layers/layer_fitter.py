"""Fits the layer coefficients of a frame: the least squared error around the face, Gauss-Newton."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import dense, origins, sample
from encoder.layers.layer_samples import coarse_luma, face_region, motion_with_head
from shared_model.animate import Face
from shared_model.layers.head_motion import BackgroundMesh
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# Gauss-Newton steps; residuals of so many grey levels count half.
STEPS, ROBUST_GREY = 3, 12.0
# Of the normal matrix' diagonal; and its least value, squared grey levels per pixel.
RELATIVE_RIDGE, RIDGE_GREY2 = 1e-3, 1e-3


@dataclass(frozen=True, slots=True)
class LayerFitter:
    """The coarse picture around the face as a function of the layer coefficients.

    face, mesh: of the person, see `motion_with_head`.  size: of the source, (width, height).
    person: (h, w) luma, times alpha.  alpha: (h, w).  scene: (h, w) luma.
    fields: (k, h, w, 2) coarse pixels.  changes: (c, h, w) luma.
    limits: (k + c, 2) the least and the largest coefficients.
    """

    face: Face
    mesh: BackgroundMesh
    size: tuple[int, int]
    person: Single
    alpha: Single
    scene: Single
    fields: Single
    changes: Single
    limits: Array

    def fit(self, picture: Picture, parameters: FaceParameters, outline_px: Array) -> Array:
        """(k + c,) the coefficients of a frame (h, w, 3) uint8 BGR.

        parameters: of the face.  outline_px: (n, 2) of the face, source pixels.
        """
        luma, at = coarse_luma(picture), self._origins(parameters)
        weight = (~self.face_region(outline_px)).astype(np.float32)
        coefficients = np.zeros(len(self.limits))
        for _ in range(STEPS if len(coefficients) else 0):
            drawn, jacobian = self._linearised(at, coefficients)
            residual = luma - drawn
            distrust = np.asarray(cv2.blur(residual, (3, 3)), np.float32) / ROBUST_GREY
            step = _solved(jacobian, residual, weight / (1 + distrust**2))
            coefficients = coefficients + step
            coefficients = np.clip(coefficients, *self.limits.T)
        return coefficients

    def draw(self, parameters: FaceParameters, coefficients: Array) -> Single:
        """(h, w) the coarse luma of a frame, without the face."""
        return self._linearised(self._origins(parameters), coefficients)[0]

    def jacobian(self, parameters: FaceParameters, coefficients: Array) -> Single:
        """(k + c, h, w) grey levels of the coarse picture per unit of each coefficient."""
        return self._linearised(self._origins(parameters), coefficients)[1]

    def face_region(self, outline_px: Array) -> NDArray[np.bool_]:
        """(h, w) where the coarse picture shows the face.  outline_px: see `fit`."""
        return face_region(outline_px, self.size, (self.scene.shape[0], self.scene.shape[1]))

    def _origins(self, parameters: FaceParameters) -> Single:
        motion = motion_with_head(self.mesh, self.face, parameters)
        shape = self.scene.shape[0], self.scene.shape[1]
        return origins(dense(motion, self.size, shape))

    def _linearised(self, at: Single, coefficients: Array) -> tuple[Single, Single]:
        """The picture and its derivatives (k + c, h, w); the person comes from `at` (h, w, 2)."""
        count = len(self.fields)
        moves = np.array([sample(field, at) for field in self.fields], np.float32)
        moves = moves.reshape(-1, *at.shape)
        own = coefficients[:count].astype(np.float32)
        at = at - np.tensordot(own, moves, 1)
        person, alpha = sample(self.person, at), sample(self.alpha, at)
        added = coefficients[count:].astype(np.float32)
        behind = np.array([sample(change, at) for change in self.changes], np.float32)
        changes = (1 - alpha) * self.changes + alpha * behind.reshape(-1, *alpha.shape)
        drawn = (1 - alpha) * self.scene + person + np.tensordot(added, changes, 1)
        gradient = sample(_gradient(self.person), at)
        gradient -= self.scene[..., None] * sample(_gradient(self.alpha), at)
        jacobian = np.concatenate([-(moves * gradient).sum(-1), changes])
        return np.asarray(drawn, np.float32), np.asarray(jacobian, np.float32)


def _gradient(image: Single) -> Single:
    """(h, w, 2) central differences."""
    across = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3) / 8
    down = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3) / 8
    return np.stack([across, down], -1).astype(np.float32)


def _solved(jacobian: Single, residual: Single, weight: Single) -> Array:
    rows = jacobian.reshape(len(jacobian), -1).astype(np.float64)
    weighted = rows * weight.ravel()
    normal = weighted @ rows.T
    ridge = RELATIVE_RIDGE * np.diag(normal) + RIDGE_GREY2 * rows.shape[1]
    return np.asarray(np.linalg.solve(normal + np.diag(ridge), weighted @ residual.ravel()))
