"""What AE shapes leave of the landmarks of a training set, as modes of the residual shape.

A muscle-based head has no actuator for each way in which faces differ, and its points are not quite
those that a landmark network means by them.  The mean of what is left is an offset of the head's
points, the rest are a few more modes of its shape.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aam.pca import principal_components
from aam.training.faces import AnnotatedFace, mirrored_face
from aam.warps import HeadWarp, ResidualModes
from aam.weak_pose import rotation_matrix
from benchmarks.validate_aam.samples import Sample
from encoder.fitting.identity import RESIDUAL_DEPTH_SIGMA_MM, RESIDUAL_SIGMA_MM
from encoder.fitting.landmark_fit import LANDMARK_SIGMA, landmark_model
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Indices
from shared_model.mesh import generic_head
from shared_model.shape_residual import control_points

# Share of the controls' variance that the modes keep.
RETAINED = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class ResidualFaces:
    """Samples whose shapes are followed by coefficients (r,) of residual modes, each in terms of
    its standard deviation.
    """

    modes: ResidualModes

    def face(self, sample: Sample, warp: HeadWarp) -> AnnotatedFace:
        """The face of a sample with its coefficients.  warp: of the head without residual."""
        return self._with(sample.face, residual_controls(sample, warp))

    def mirrored(self, sample: Sample, warp: HeadWarp) -> AnnotatedFace:
        """The mirror image of the same."""
        controls = mirrored_controls(residual_controls(sample, warp))
        return self._with(mirrored_face(sample.face), controls)

    def _with(self, face: AnnotatedFace, controls: Array) -> AnnotatedFace:
        modes = self.modes.modes.reshape(len(self.modes.modes), -1)
        left = (controls - self.modes.mean).ravel()
        coefficients = np.linalg.lstsq(modes.T, left, rcond=None)[0]
        return replace(face, shape=np.concatenate([face.shape, coefficients]))


def residual_faces(samples: Sequence[Sample], warp: HeadWarp) -> ResidualFaces:
    """The modes of samples and their mirror images.  warp: of the head without residual."""
    found = parallel_map(lambda sample: residual_controls(sample, warp), samples, None)
    controls = np.array([*found, *map(mirrored_controls, found)])
    linear = principal_components(controls.reshape(len(controls), -1), RETAINED)
    modes = np.sqrt(linear.variances)[:, None] * linear.modes
    shape = controls.shape[1:]
    return ResidualFaces(ResidualModes(linear.mean.reshape(shape), modes.reshape(-1, *shape)))


def residual_controls(sample: Sample, warp: HeadWarp) -> Array:
    """(k, 3) mm, head frame: controls of the residual shape that explain what pose and AE shape
    leave of the landmarks, with the priors of `risorius annotate --residual`.
    """
    face, basis = sample.face, landmark_model(generic_head()).residual
    left = sample.landmarks[warp.landmark_index] - warp.landmarks(face.shape, face.pose)
    across = np.exp(face.pose[5]) * rotation_matrix(face.pose)[:2]
    precision = 1 / (LANDMARK_SIGMA * sample.eye_distance) ** 2
    known = np.isfinite(left[:, 0])
    basis, left = basis[:, known], left[known]
    sigma_mm = np.array([RESIDUAL_SIGMA_MM, RESIDUAL_SIGMA_MM, RESIDUAL_DEPTH_SIGMA_MM])
    normal = precision * np.kron(basis @ basis.T, across.T @ across)
    normal += np.diag(np.tile(1 / sigma_mm**2, len(basis)))
    gradient = precision * (basis @ left @ across)
    return np.asarray(np.linalg.solve(normal, gradient.ravel()).reshape(-1, 3))


def mirrored_controls(controls: Array) -> Array:
    """The controls (k, 3) of the mirror image of a face."""
    return np.asarray(controls[_mirror_images()] * [-1, 1, 1])


def _mirror_images() -> Indices:
    head = generic_head()
    points = head.vertices[control_points(head)]
    distance = np.linalg.norm(points[:, None] * [-1, 1, 1] - points[None], axis=2)
    return np.asarray(distance.argmin(1))
