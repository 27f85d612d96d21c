"""One caller, ready to be drawn: synthesise texture -> animate -> warp background -> render.

A well-formed model packet may describe a face that cannot be drawn: it is refused here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from decoder.appearance import AppearanceModel
from decoder.background_layers import BackgroundLayers, load_background
from decoder.layer_motion import LayerMotion
from decoder.mouth_shading import mouth_shading
from decoder.playout import PlayoutFrame
from decoder.rendering.render_geometry import NEAR_MM
from decoder.rendering.renderer import Renderer
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import AAU_STEP, EAU_STEP, RESIDUAL_STEP_MM, values_from_codes
from protocol.model_packet import ModelPacket
from shared_model.animate import Face, identity_from_controls
from shared_model.geometry import Camera, camera_from_head
from shared_model.layers.head_motion import (
    BackgroundMesh,
    make_background_mesh,
    projected_face_width_px,
    warp,
)
from shared_model.mesh import Head, generic_head
from shared_model.parameters import Pose
from shared_model.shape_residual import residual_basis
from shared_model.stage_timer import StageTimer
from shared_model.surround import head_with_surround

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# In pictures up to this size, lips and teeth are a pixel thick and multisampling is cheap.
SMALL_PX = 352 * 288
SMALL_SAMPLES = 4
# A picture takes 3 bytes a pixel, its buffers 8, and several pictures are queued.
MAX_PICTURE_PX = 4096 * 4096
# Antialiasing blends the outline of the face with the background; drawn wider by so much, the face
# reaches its contour in the background picture.
EDGE_EXPANSION_PX = 0.7
# Narrower faces in the background picture are refused.
MIN_FACE_WIDTH_PX = 4.0


@dataclass(frozen=True, slots=True)
class FrameState:
    """What the renderer draws of a frame, see `Renderer.submit`.

    texture, change: None: unchanged.
    """

    texture: Picture | None
    pose: Pose
    vertices: Array
    grid_px: Array
    mouth_shading: float | None
    change: Picture | None = None


class Scene:
    """The face, texture and background of a model, on a renderer.

    model: the model packet with the layers applied so far.
    Raises `ProtocolError` if the model cannot be drawn.
    """

    def __init__(self, model: ModelPacket, head: Head) -> None:
        self.model = model
        self._camera, self._head = model.call.camera, head
        # The modes of the default profile include the light inside the mouth.
        self._shade_mouth = model.call.profile == "thesis"
        check_size(self._camera)
        self._face = self._own_face = face_from_model(model, head)
        rest = self._face.animate(values_from_codes(model.reference_eau, EAU_STEP))
        check_reference(self._camera, model.reference_pose, head, rest)
        self._appearance = AppearanceModel(model)
        size = model.call.width, model.call.height
        layers = load_background(model.background, *size)
        self._background: BackgroundMesh = make_background_mesh(
            self._camera, model.reference_pose, head, rest
        )
        self._renderer = Renderer(*size, head, edge_samples(*size))
        self._renderer.set_texture(self._appearance.synthesise(np.zeros(0)))
        self._set_background(layers)

    def update(self, model: ModelPacket) -> None:
        """Update the scene to further layers of the same model.

        Raises `ProtocolError` if a layer is damaged; those that do not depend on it are drawn.
        """
        before, self.model = self.model, model
        try:
            if model.background != before.background:
                size = model.call.width, model.call.height
                self._set_background(load_background(model.background, *size))
        finally:
            self._update_texture(model)

    def _set_background(self, layers: BackgroundLayers) -> None:
        self._motion = LayerMotion(self._background, layers)
        self._renderer.set_background(layers.moving, self._background.grid_px, layers.static)

    def _update_texture(self, model: ModelPacket) -> None:
        try:
            self._appearance.update(model)
        finally:
            self._renderer.set_texture(self._appearance.synthesise(np.zeros(0)))

    def set_aau_offset(self, aau: Array) -> None:
        """Draw the caller with `aau` (len(AAUS),) added to their own AAUs from now on."""
        self._face = self._own_face.with_aau_offset(aau)

    def draw(self, frame: PlayoutFrame, timer: StageTimer) -> Picture:
        """The picture of one frame, (height, width, 3) uint8 BGR."""
        self.submit(self.prepare(frame, timer), timer)
        return self.read_back(timer)

    def prepare(self, frame: PlayoutFrame, timer: StageTimer) -> FrameState:
        """Compute the state of a frame; the renderer may draw another one at the same time."""
        texture = None
        if self._appearance.has_modes:
            with timer.stage("texture"):
                texture = self._appearance.synthesise(frame.face.modes)
        with timer.stage("animate"):
            vertices = self._face.animate(frame.face.eau)
        with timer.stage("warp"):
            pose = pushed_before_camera(frame.face.pose, vertices)
            own_motion = self._motion.own_motion(frame.face.layers)
            grid_px = warp(self._background, pose, vertices, own_motion)
            shading = mouth_shading(self._head, vertices) if self._shade_mouth else None
            change = self._motion.change(frame.face.layers)
        return FrameState(texture, pose, vertices, grid_px, shading, change)

    def submit(self, state: FrameState, timer: StageTimer) -> None:
        """Start drawing a frame; `read_back` returns its picture."""
        with timer.stage("render"):
            if state.texture is not None:
                self._renderer.set_texture(state.texture)
            self._renderer.submit(
                self._camera,
                state.pose,
                state.vertices,
                state.grid_px,
                state.mouth_shading,
                EDGE_EXPANSION_PX,
                state.change,
            )

    def read_back(self, timer: StageTimer) -> Picture:
        """The picture of the frame submitted last, (height, width, 3) uint8 BGR."""
        with timer.stage("render"):
            return self._renderer.read_back()

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


def head_of(model: ModelPacket) -> Head:
    """The head mesh of the call's profile."""
    return head_with_surround() if model.call.profile == "default" else generic_head()


def edge_samples(width: int, height: int) -> int:
    """Colour samples per pixel of a picture of this size."""
    return SMALL_SAMPLES if width * height <= SMALL_PX else 0


def face_from_model(model: ModelPacket, head: Head) -> Face:
    """The caller's head.

    A residual without points stands for zero.
    Raises `ProtocolError` if the residual has another number of points than the head.
    """
    aau = values_from_codes(model.aau, AAU_STEP)
    control_mm = values_from_codes(model.residual, RESIDUAL_STEP_MM).reshape(-1, 3)
    expected = len(residual_basis(head))
    if not len(control_mm):
        control_mm = np.zeros((expected, 3))
    if len(control_mm) != expected:
        raise ProtocolError(
            f"model packet's residual has {len(control_mm)} points, this program's head {expected}"
        )
    return Face(head, identity_from_controls(head, aau, control_mm))


def check_size(camera: Camera) -> None:
    """Raise `ProtocolError` if the call's pictures exceed `MAX_PICTURE_PX`."""
    if camera.width * camera.height > MAX_PICTURE_PX:
        raise ProtocolError(
            f"pictures of {camera.width}x{camera.height}, limit {MAX_PICTURE_PX} pixels"
        )


def check_reference(camera: Camera, pose: Pose, head: Head, vertices: Array) -> None:
    """Raise `ProtocolError` if the face is behind the camera or too small at the reference pose.

    vertices: (n, 3) float64, mm, head frame: the head in the background picture.
    """
    nearest_mm = float(camera_from_head(pose, vertices)[:, 2].min())
    if nearest_mm < NEAR_MM:
        raise ProtocolError(f"reference pose puts the head {nearest_mm:.0f} mm before the camera")
    width_px = projected_face_width_px(camera, pose, head, vertices)
    if width_px < MIN_FACE_WIDTH_PX:
        raise ProtocolError(f"reference pose makes the face {width_px:.1g} px wide")


def pushed_before_camera(pose: Pose, vertices: Array) -> Pose:
    """The pose, moved away from the camera if a part of the head would be nearer than `NEAR_MM`.

    vertices: (n, 3) float64, mm, head frame.
    """
    nearest_mm = float(camera_from_head(pose, vertices)[:, 2].min())
    if nearest_mm >= NEAR_MM:
        return pose
    return Pose(pose.rotation, pose.translation_mm + np.array([0.0, 0.0, NEAR_MM - nearest_mm]))
