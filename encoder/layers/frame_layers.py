"""What fits and codes the layer coefficients of frames, for as long as a background is in use."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.layers.layer_fitter import LayerFitter
from encoder.layers.layer_samples import FittedFrames, reference_mesh
from shared_model.arrays import Array, Picture
from shared_model.parameters import FaceParameters

# Largest coefficients of later frames, in the range of those of the sample.
LIMIT_FACTOR = 2.0
# Frames at which the distortion is measured.
DISTORTION_FRAMES = 12


@dataclass(frozen=True, slots=True, eq=False)
class FrameLayers:
    """The layers of frames.

    fitter: of the picture around the face.
    distortion: (l, l) squared grey levels around the face per squared unit of the coefficients, for
        each pixel of the face.
    prior_variance: (l,) of coefficients that a sample does not show; None: it shows all.
    """

    fitter: LayerFitter
    distortion: Array
    prior_variance: Array | None = None

    @property
    def count(self) -> int:
        """Number of layer coefficients of a frame."""
        return len(self.distortion)

    def fitted(self, picture: Picture, face: FaceParameters, outline_px: Array) -> FaceParameters:
        """A face with the layer coefficients of its frame, see `LayerFitter.fit`."""
        return replace(face, layers=self.fitter.fit(picture, face, outline_px))

    def with_wide_limits(self) -> "FrameLayers":
        """The same for frames that may be far from all that the layers were learned from."""
        low, high = self.fitter.limits.T
        reach = LIMIT_FACTOR * (high - low)
        return replace(self, fitter=replace(self.fitter, limits=np.stack([-reach, reach], 1)))

    def fitted_all(self, frames: FittedFrames) -> list[FaceParameters]:
        """The faces of some frames with their layer coefficients."""
        each = zip(frames.pictures, frames.faces, frames.outlines_px, strict=True)
        return [self.fitted(*frame) for frame in each]

    def of_person(self, frames: FittedFrames) -> "FrameLayers":
        """The same for a new model of the person; the canonical frame stays."""
        fitter = replace(self.fitter, face=frames.person, mesh=reference_mesh(frames))
        return replace(self, fitter=fitter)


def layer_distortion(
    fitter: LayerFitter,
    faces: Sequence[FaceParameters],
    outlines_px: Sequence[Array] | Array,
    coefficients: Array,
) -> Array:
    """See `FrameLayers.distortion`; the mean over some of the frames.

    faces, outlines_px, coefficients: of each frame.
    """
    total, face_pixels = np.zeros((coefficients.shape[1],) * 2), 0
    chosen = range(0, len(coefficients), -(-len(coefficients) // DISTORTION_FRAMES))
    for i in chosen:
        region = fitter.face_region(outlines_px[i])
        rows = fitter.jacobian(faces[i], coefficients[i])[:, ~region].astype(np.float64)
        total += rows @ rows.T
        face_pixels += int(region.sum())
    # Light is a component of its own: where it stays as it is, no other's error is to change it.
    count = len(fitter.limits)
    total[:count, count:] = total[count:, :count] = 0
    return total / max(face_pixels, 1)
