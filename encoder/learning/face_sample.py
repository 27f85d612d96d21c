"""A frame's face as modes are learned from it, and as it waits to be fitted again."""

from dataclasses import dataclass

from encoder.capture.face_crop import Crop
from shared_model.arrays import Array, Picture
from shared_model.parameters import FaceParameters


@dataclass(frozen=True, slots=True)
class FaceSample:
    """A crop of a frame, and the landmarks (468, 3) in the frame, pixels.

    face: the fitted face; None if it is not fitted by the model that modes are learned for.
    coarse: the whole frame, small, see `encoder.layers`; None if only the face is fitted.
    window: what is around the face, small, for hands to be found in; None: they are not looked for.
    """

    crop: Crop
    landmarks: Array
    face: FaceParameters | None = None
    coarse: Picture | None = None
    window: Crop | None = None
