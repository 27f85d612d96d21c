"""What fits give: the identity of a person, and a fit of their texture to one frame."""

from dataclasses import dataclass

from shared_model.animate import Identity
from shared_model.arrays import Array
from shared_model.geometry import Camera
from shared_model.parameters import FaceParameters


@dataclass(frozen=True, slots=True)
class IdentityFit:
    """Identity of a person and lens of their camera, with the faces of the frames fitted together.

    control_mm: (k, 3) displacement of the residual's control points.
    frames: pose and actuators in each frame.
    information: (n, n) inverse covariance of log f, AAUs, controls and of pose and actuators of the
        single frame, in the order of `apply_identity_increment`; None where it is unknown.
    """

    camera: Camera
    identity: Identity
    control_mm: Array
    frames: tuple[FaceParameters, ...]
    information: Array | None = None


@dataclass(frozen=True, slots=True)
class TextureFit:
    """A fit of the textured model to one frame.

    face: pose and actuators; its modes are gain, offset and slopes of the light.
    correlation: of picture and texture over the visible texels, -1..1, low-order light removed.
    left_grey2: robust mean square of the residual, squared grey levels.
    noise_grey: robust standard deviation of the residual, grey levels.
    """

    face: FaceParameters
    correlation: float
    residual_mse_grey2: float
    residual_sigma_grey: float
