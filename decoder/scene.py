"""One caller, ready to be drawn: texture -> animate -> composite -> render.

A model packet can be well-formed and still be no caller: what cannot be drawn is refused here.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from decoder.appearance import Wardrobe
from decoder.background_layers import still_of
from decoder.background_warp import Backdrop, drawn_width_px, make_backdrop, mouth_light, warp
from decoder.playout import PlayedFrame
from decoder.renderer import NEAR_MM, Renderer
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import AAU_STEP, EAU_STEP, RESIDUAL_STEP_MM, values_from_codes
from protocol.model_packet import ModelPacket
from shared_model.animate import Face, identity_from_controls
from shared_model.anthropometry import residual_basis
from shared_model.geometry import Camera, camera_from_head
from shared_model.mesh import Head, generic_head
from shared_model.parameters import Pose
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# In pictures up to this size lips and teeth are a pixel thick, and smoothing edges is cheap.
SMALL_PX = 352 * 288
SMALL_SAMPLES = 4
# Larger pictures are refused: each takes 3 bytes a pixel, its buffers 8, and several are waiting.
MAX_PICTURE_PX = 4096 * 4096
# Matting at the outline takes from the face; drawn this much wider it meets the still's contour.
RIM_PX = 0.7
# A face narrower than this in the still is none.
LEAST_FACE_PX = 4.0


@dataclass(frozen=True, slots=True)
class Posed:
    """What a frame looks like, see `Renderer.begin`.  texture: None: as it was."""

    texture: Picture | None
    pose: Pose
    vertices: Array
    grid_px: Array
    light: float | None


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
        self._wardrobe = Wardrobe(model)
        still = still_of(model.background)
        self._backdrop: Backdrop = make_backdrop(self._camera, model.reference_pose, head, rest)
        size = model.call.width, model.call.height
        self._renderer = Renderer(*size, head, edge_samples(*size))
        self._renderer.set_texture(self._wardrobe.texture(np.zeros(0)))
        self._renderer.set_backdrop(still.picture, self._backdrop.grid_px, still.behind)

    def refine(self, model: ModelPacket) -> None:
        """Take in what more layers of the same model bring.

        Raises `ProtocolError` if one of them is damaged; what does not build on it is drawn.
        """
        before, self.model = self.model, model
        try:
            if model.background != before.background:
                still = still_of(model.background)
                self._renderer.set_backdrop(still.picture, self._backdrop.grid_px, still.behind)
        finally:
            self._refine_texture(model)

    def _refine_texture(self, model: ModelPacket) -> None:
        try:
            self._wardrobe.refine(model)
        finally:
            self._renderer.set_texture(self._wardrobe.texture(np.zeros(0)))

    def reshape(self, aau: Array) -> None:
        """From now on draw the caller with `aau` (len(AAUS),) added to their own AAUs."""
        self._face = self._own_face.reshaped(aau)

    def draw(self, frame: PlayedFrame, clock: "StageClock") -> Picture:
        """The picture of one frame, (height, width, 3) uint8 BGR."""
        self.begin(self.pose(frame, clock), clock)
        return self.picture(clock)

    def pose(self, frame: PlayedFrame, clock: "StageClock") -> "Posed":
        """Work out what a frame looks like, which may be done while another one is drawn."""
        texture = None
        if self._wardrobe.changes:
            with clock.stage("texture"):
                texture = self._wardrobe.texture(frame.face.modes)
        with clock.stage("animate"):
            vertices = self._face.animate(frame.face.eau)
        with clock.stage("composite"):
            pose = before_camera(frame.face.pose, vertices)
            grid_px = warp(self._backdrop, pose, vertices)
            light = mouth_light(self._head, vertices) if self._shade_mouth else None
        return Posed(texture, pose, vertices, grid_px, light)

    def begin(self, posed: "Posed", clock: "StageClock") -> None:
        """Have a frame drawn, beside what the caller does until it asks for `picture`."""
        with clock.stage("render"):
            if posed.texture is not None:
                self._renderer.set_texture(posed.texture)
            self._renderer.begin(
                self._camera, posed.pose, posed.vertices, posed.grid_px, posed.light, RIM_PX
            )

    def picture(self, clock: "StageClock") -> Picture:
        """The picture of the frame that was begun last, (height, width, 3) uint8 BGR."""
        with clock.stage("render"):
            return self._renderer.picture()

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


class StageClock:
    """Adds up the time of each stage."""

    def __init__(self) -> None:
        self._total_ns: dict[str, int] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time in the `with` block for stage `name`."""
        start = time.perf_counter_ns()
        try:
            yield
        finally:
            spent = time.perf_counter_ns() - start
            self._total_ns[name] = self._total_ns.get(name, 0) + spent

    def mean_ms(self, frames: int) -> dict[str, float]:
        """Milliseconds per frame of each stage."""
        return {name: ns / 1e6 / max(frames, 1) for name, ns in self._total_ns.items()}


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
    width_px = drawn_width_px(camera, pose, head, vertices)
    if width_px < LEAST_FACE_PX:
        raise ProtocolError(f"reference pose makes the face {width_px:.1g} px wide")


def before_camera(pose: Pose, vertices: Array) -> Pose:
    """The pose, moved away from the camera if a part of the head would be behind it.

    vertices: (n, 3) float64, mm, head frame.
    """
    nearest_mm = float(camera_from_head(pose, vertices)[:, 2].min())
    if nearest_mm >= NEAR_MM:
        return pose
    return Pose(pose.rotation, pose.translation_mm + np.array([0.0, 0.0, NEAR_MM - nearest_mm]))
