"""One caller, ready to be drawn: texture -> animate -> composite -> render.

A model packet can be well-formed and still be no caller: what cannot be drawn is refused here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from decoder.appearance import AppearanceModel
from decoder.background_layers import load_background
from decoder.background_warp import (
    BackgroundMesh,
    make_background_mesh,
    mouth_shading,
    projected_face_width_px,
    warp,
)
from decoder.playout import PlayoutFrame
from decoder.renderer import NEAR_MM, Renderer
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import AAU_STEP, EAU_STEP, RESIDUAL_STEP_MM, values_from_codes
from protocol.model_packet import ModelPacket
from shared_model.animate import Face, identity_from_controls
from shared_model.anthropometry import residual_basis
from shared_model.geometry import Camera, camera_from_head
from shared_model.mesh import Head, generic_head
from shared_model.parameters import Pose
from shared_model.stage_timer import StageTimer
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# In pictures up to this size lips and teeth are a pixel thick, and smoothing edges is cheap.
SMALL_PX = 352 * 288
SMALL_SAMPLES = 4
# Larger pictures are refused: each takes 3 bytes a pixel, its buffers 8, and several are waiting.
MAX_PICTURE_PX = 4096 * 4096
# Matting at the outline takes from the face; drawn this much wider it meets the still's contour.
EDGE_EXPANSION_PX = 0.7
# A face narrower than this in the still is none.
MIN_FACE_WIDTH_PX = 4.0


@dataclass(frozen=True, slots=True)
class FrameState:
    """What a frame looks like, see `Renderer.begin`.  texture: None: as it was."""

    texture: Picture | None
    pose: Pose
    vertices: Array
    grid_px: Array
    mouth_shading: float | None


class Scene:
    """One caller, ready to be drawn: face, texture and backdrop on the renderer.

    model: what it was made of.

    Raises `ProtocolError` if the model packet is none that can be drawn.
    """

    def __init__(self, model: ModelPacket, head: Head) -> None:
        self.model = model
        self._camera, self._head = model.call.camera, head
        # Where modes paint the inside of the mouth they have its light in them.
        self._shade_mouth = model.call.profile == "thesis"
        check_size(self._camera)
        self._face = self._own_face = face_from_model(model, head)
        rest = self._face.animate(values_from_codes(model.reference_eau, EAU_STEP))
        check_reference(self._camera, model.reference_pose, head, rest)
        self._appearance = AppearanceModel(model)
        still = load_background(model.background)
        self._background: BackgroundMesh = make_background_mesh(
            self._camera, model.reference_pose, head, rest
        )
        size = model.call.width, model.call.height
        self._renderer = Renderer(*size, head, edge_samples(*size))
        self._renderer.set_texture(self._appearance.synthesise(np.zeros(0)))
        self._renderer.set_background(still.moving, self._background.grid_px, still.static)

    def update(self, model: ModelPacket) -> None:
        """Take in what more layers of the same model bring.

        Raises `ProtocolError` if one of them is damaged; what does not build on it is drawn.
        """
        before, self.model = self.model, model
        try:
            if model.background != before.background:
                still = load_background(model.background)
                self._renderer.set_background(still.moving, self._background.grid_px, still.static)
        finally:
            self._update_texture(model)

    def _update_texture(self, model: ModelPacket) -> None:
        try:
            self._appearance.update(model)
        finally:
            self._renderer.set_texture(self._appearance.synthesise(np.zeros(0)))

    def set_aau_offset(self, aau: Array) -> None:
        """From now on draw the caller with `aau` (len(AAUS),) added to their own AAUs."""
        self._face = self._own_face.reshaped(aau)

    def draw(self, frame: PlayoutFrame, timer: StageTimer) -> Picture:
        """The picture of one frame, (height, width, 3) uint8 BGR."""
        self.submit(self.prepare(frame, timer), timer)
        return self.read_back(timer)

    def prepare(self, frame: PlayoutFrame, timer: StageTimer) -> "FrameState":
        """Work out what a frame looks like, which may be done while another one is drawn."""
        texture = None
        if self._appearance.has_modes:
            with timer.stage("texture"):
                texture = self._appearance.synthesise(frame.face.modes)
        with timer.stage("animate"):
            vertices = self._face.animate(frame.face.eau)
        with timer.stage("composite"):
            pose = pushed_before_camera(frame.face.pose, vertices)
            grid_px = warp(self._background, pose, vertices)
            light = mouth_shading(self._head, vertices) if self._shade_mouth else None
        return FrameState(texture, pose, vertices, grid_px, light)

    def submit(self, posed: "FrameState", timer: StageTimer) -> None:
        """Have a frame drawn, beside what the caller does until it asks for `picture`."""
        with timer.stage("render"):
            if posed.texture is not None:
                self._renderer.set_texture(posed.texture)
            self._renderer.submit(
                self._camera,
                posed.pose,
                posed.vertices,
                posed.grid_px,
                posed.mouth_shading,
                EDGE_EXPANSION_PX,
            )

    def read_back(self, timer: StageTimer) -> Picture:
        """The picture of the frame that was begun last, (height, width, 3) uint8 BGR."""
        with timer.stage("render"):
            return self._renderer.read_back()

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


def head_of(model: ModelPacket) -> Head:
    """The mesh that the call's profile animates."""
    return surrounded_head() if model.call.profile == "default" else generic_head()


def edge_samples(width: int, height: int) -> int:
    """Colour samples a pixel for a picture of this size."""
    return SMALL_SAMPLES if width * height <= SMALL_PX else 0


def face_from_model(model: ModelPacket, head: Head) -> Face:
    """The caller's own head.

    Raises `ProtocolError` if the residual has another number of points than the head; none stands
    for a residual of zero.
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
    """Raise `ProtocolError` if the call's pictures are larger than this program draws."""
    if camera.width * camera.height > MAX_PICTURE_PX:
        raise ProtocolError(
            f"pictures of {camera.width}x{camera.height}, limit {MAX_PICTURE_PX} pixels"
        )


def check_reference(camera: Camera, pose: Pose, head: Head, vertices: Array) -> None:
    """Raise `ProtocolError` unless the still can show the face.

    vertices: (n, 3) float64, mm, head frame: the head in the still.
    """
    nearest_mm = float(camera_from_head(pose, vertices)[:, 2].min())
    if nearest_mm < NEAR_MM:
        raise ProtocolError(f"reference pose puts the head {nearest_mm:.0f} mm before the camera")
    width_px = projected_face_width_px(camera, pose, head, vertices)
    if width_px < MIN_FACE_WIDTH_PX:
        raise ProtocolError(f"reference pose makes the face {width_px:.1g} px wide")


def pushed_before_camera(pose: Pose, vertices: Array) -> Pose:
    """The pose, moved away from the camera if a part of the head would be behind it.

    vertices: (n, 3) float64, mm, head frame.
    """
    nearest_mm = float(camera_from_head(pose, vertices)[:, 2].min())
    if nearest_mm >= NEAR_MM:
        return pose
    return Pose(pose.rotation, pose.translation_mm + np.array([0.0, 0.0, NEAR_MM - nearest_mm]))
