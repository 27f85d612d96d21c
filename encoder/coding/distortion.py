"""The distortion of the decoded picture by errors of the coded parameters.

The Gauss-Newton Hessian of the shape-free residual, plus perceptual weights of the EAUs.  y is the
vector of pose, EAUs and mode coefficients, see `vector_from_face`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.capture.colour import luma_f32
from encoder.capture.face_crop import Crop
from encoder.fitting.analysis_by_synthesis import TexelFitter
from encoder.learning.person_model import TrainedModel
from protocol.frames.frame_transform import GEOMETRY_SIZE, vector_from_face
from protocol.frames.scalar_quantiser import pose_from_motion
from runtime.image_ops import sample_bicubic
from shared_model.arrays import Array, Single
from shared_model.parameters import EAUS, LIDS, FaceParameters, Pose, clip_eau

# Steps of the numeric derivatives: degrees, mm, log depth, EAUs.
_DERIVATIVE_STEP = np.array([0.2, 0.2, 0.2, 0.4, 0.4, 0.002, *[0.03] * (GEOMETRY_SIZE - 6)])
# Perceptual distortion of EAU errors in addition to the squared grey error, grey^2 per squared
# unit; (2, 2) of the left and right eyelid.  A blink is small and lasts two or three frames, so
# that a missed one hardly changes PSNR.
EAU_DISTORTION, EYELID_DISTORTION = 4.0, 40.0 * np.eye(len(LIDS))
_EYELID_ROWS = [6 + index for index in LIDS]
_OTHER_EAU_ROWS = [6 + index for index in range(len(EAUS)) if index not in LIDS]
# Frames of the training sample at which the distortion is measured.
DISTORTION_FRAMES = 12
RELATIVE_RIDGE = 1e-5
# Weight of squared errors around the face, against those in the face; and the least distortion.
LAYER_SHARE, LAYER_RIDGE = 0.1, 1e-3


@dataclass(frozen=True, slots=True)
class DistortionModel:
    """Squared grey error of a person's face per error of y, for any modes.

    weight: (k,) mean weight of each texel over some frames, of sum 1.
    weighted_jacobian: (k, GEOMETRY_SIZE) mean of weight times grey levels per unit of geometry.
    geometry_hessian: (GEOMETRY_SIZE, GEOMETRY_SIZE) mean squared grey error per squared unit.
    """

    weight: Array
    weighted_jacobian: Array
    geometry_hessian: Array

    def distortion_matrix(
        self, modes: Single, eyelid_distortion: Array = EYELID_DISTORTION
    ) -> Array:
        """(d, d) mean squared grey error per squared unit of y, with the perceptual weights.

        modes: (m, k) luma.  eyelid_distortion: (2, 2), see `EYELID_DISTORTION`.
        """
        cross = -self.weighted_jacobian.T @ modes.T
        mode_hessian = (modes * self.weight) @ modes.T
        matrix = np.block([[self.geometry_hessian, cross], [cross.T, mode_hessian]])
        matrix[_OTHER_EAU_ROWS, _OTHER_EAU_ROWS] += EAU_DISTORTION
        matrix[np.ix_(_EYELID_ROWS, _EYELID_ROWS)] += eyelid_distortion
        matrix[np.diag_indices(len(matrix))] *= 1 + RELATIVE_RIDGE
        return np.asarray(matrix, np.float64)


def distortion_of(trained: TrainedModel) -> DistortionModel:
    """The distortion model of a person, from some frames of the training sample."""
    person = trained.person
    chosen = slice(None, None, max(1, len(trained.crops) // DISTORTION_FRAMES))
    pose = person.reference.pose
    return measure_distortion(
        person.texel_fitter, trained.crops[chosen], trained.faces[chosen], pose
    )


def measure_distortion(
    fitter: TexelFitter, crops: Sequence[Crop], faces: Sequence[FaceParameters], reference: Pose
) -> DistortionModel:
    """The mean distortion at some frames.  reference: see `vector_from_face`."""
    count = len(fitter.shape)
    weight = np.zeros(count)
    weighted_jacobian = np.zeros((count, GEOMETRY_SIZE))
    geometry_hessian = np.zeros((GEOMETRY_SIZE, GEOMETRY_SIZE))
    for crop, face in zip(crops, faces, strict=True):
        jacobian = _luma_jacobian(fitter.shape, crop, face, reference).astype(np.float64)
        visible = fitter.template.weight * fitter.visible(face)
        share = visible.astype(np.float64) / visible.sum() / len(crops)
        weighted = jacobian * share[:, None]
        weight += share
        weighted_jacobian += weighted
        geometry_hessian += weighted.T @ jacobian
    return DistortionModel(weight, weighted_jacobian, geometry_hessian)


def _luma_jacobian(
    shape: ShapeFreeFrame, crop: Crop, face: FaceParameters, reference: Pose
) -> Single:
    """(k, GEOMETRY_SIZE) grey levels per unit of geometry, by central differences."""
    y = vector_from_face(face, reference)
    luma = luma_f32(crop.picture)

    def sampled(index: int, difference: float) -> Single:
        shifted = y.copy()
        shifted[index] += difference
        pose = pose_from_motion(shifted[:6], reference)
        moved = FaceParameters(pose, clip_eau(shifted[6:GEOMETRY_SIZE]))
        return sample_bicubic(luma, crop.to_crop_px(shape.positions(moved)))[:, 0]

    columns = [
        (sampled(index, step) - sampled(index, -step)) / (2 * step)
        for index, step in enumerate(_DERIVATIVE_STEP)
    ]
    return np.asarray(np.stack(columns, 1), np.float32)


def with_layers(distortion: Array, layers: Array) -> Array:
    """The distortion matrix of y with layer coefficients, see `vector_from_face`.

    distortion: (d, d) without them.  layers: (l, l) squared grey levels around the face per squared
    unit of the coefficients, for each pixel of the face.
    """
    count = len(layers)
    at = np.r_[:GEOMETRY_SIZE, GEOMETRY_SIZE + count : len(distortion) + count]
    matrix = np.zeros((len(distortion) + count,) * 2)
    matrix[np.ix_(at, at)] = distortion
    own = slice(GEOMETRY_SIZE, GEOMETRY_SIZE + count)
    matrix[own, own] = LAYER_SHARE * layers
    matrix[own, own] += LAYER_RIDGE * np.eye(count)
    return matrix
