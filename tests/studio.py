"""Pictures of the painted generic head with noise, and fits of its texture to them."""

import numpy as np

from decoder.rendering.renderer import Renderer
from encoder.fitting.fit_results import TextureFit
from encoder.thesis.person_texture import PersonTexture
from risorius.animation.synthetic_skin import painted_colours
from shared_model.animate import Face, Identity
from shared_model.geometry import Camera, euler_deg, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, FaceParameters

HEAD = generic_head()
FACE = Face(HEAD, Identity(np.zeros(len(AAUS)), np.zeros_like(HEAD.vertices)))
CAMERA = Camera(256, 224, 360.0)
PLACE = np.array([5.0, -4.0, 520.0])
REST = FaceParameters(pose_from_euler(0, 0, 0, PLACE))
JAW, BROW = EAU_INDEX["jaw_drop"], EAU_INDEX["eyebrow_inner"]


class Studio:
    """Draws the painted head with noise of 2 grey levels."""

    def __init__(self) -> None:
        self._renderer = Renderer(CAMERA.width, CAMERA.height, HEAD, samples=4)
        self._colours = painted_colours(HEAD, mottle=0.15, seed=3)
        self._random = np.random.default_rng(2)

    def draw(self, face: FaceParameters, light: float = 1.0) -> np.ndarray:
        """A picture, (224, 256, 3) uint8 BGR, with brightness multiplied by `light`."""
        vertices = FACE.animate(face.eau)
        drawn = self._renderer.draw_shaded(CAMERA, face.pose, vertices, self._colours)
        noisy = light * drawn + self._random.normal(0, 2, drawn.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def fitted(
    texture: PersonTexture,
    picture: np.ndarray,
    start: FaceParameters,
    active: list[int],
    steps: int,
) -> TextureFit:
    """The fit to a picture from `start`, with these actuators free, in so many steps."""
    return texture.fit(texture.observe(picture, start), start, active, steps)


def angle_error_deg(found: FaceParameters, truth: FaceParameters) -> float:
    """The largest error of the three Euler angles."""
    return float(np.abs(np.subtract(euler_deg(found.pose), euler_deg(truth.pose))).max())
