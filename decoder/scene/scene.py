"""One caller, ready to be drawn: synthesise texture -> animate -> warp background -> render.

`decoded_model` decodes what is drawn here.
"""

import cv2
import numpy as np

from decoder.rendering.render_geometry import NEAR_MM
from decoder.rendering.renderer import FrameState, Renderer
from decoder.scene.decoded_model import DecodedModel
from protocol.model_packet import ModelPacket
from shared_model.arrays import Array, Picture, Single
from shared_model.geometry import Camera, camera_from_head, pixel_from_head
from shared_model.layers.head_motion import smoothstep, warp
from shared_model.mesh import PARTS, Head
from shared_model.parameters import LIDS, FaceParameters, Pose
from shared_model.stage_timer import StageTimer

# The outline of the face fades into the background over a pixel; drawn wider by so much, the face
# reaches its contour in the background picture.
EDGE_EXPANSION_PX = 0.7
# Skin that is more opaque than this is of the face.
FACE_OPACITY = 0.5
# The area of the face is averaged over a square: its side is 1 more than twice this share of the
# picture's.
SOFT_SHARE = 1 / 320
# Light inside the mouth when the lips are closed; at this distance of the lips it is 1.
CLOSED_MOUTH_LIGHT = 0.35
OPEN_MOUTH_MM = 12.0


class Scene:
    """The face, texture and background of a model, on a renderer."""

    def __init__(self, decoded: DecodedModel) -> None:
        size = decoded.model.call.width, decoded.model.call.height
        self._submitted: FrameState | None = None
        self._empty: Picture | None = None  # the frame submitted last without the person
        self._renderer = Renderer(*size, decoded.head)
        self._own_face = self._face = decoded.face
        self._show(decoded)
        self._show_background()

    @property
    def model(self) -> ModelPacket:
        """The model that is drawn."""
        return self._decoded.model

    @property
    def damages(self) -> int:
        """Number of further layers of the model that were damaged."""
        return len(self._decoded.damages)

    def fits(self, decoded: DecodedModel) -> bool:
        """Whether the renderer can draw a model: it has the size and the topology of this one."""
        before = self._decoded.model.call
        size = decoded.model.call.width, decoded.model.call.height
        return decoded.head is self._decoded.head and size == (before.width, before.height)

    def change(self, decoded: DecodedModel) -> None:
        """Draw another model that `fits`, or further layers of the same."""
        before = self._decoded
        self._show(decoded)
        if decoded.face is not before.face:
            self._own_face = self._face = decoded.face
        if decoded.layers is not before.layers or decoded.mesh is not before.mesh:
            self._show_background()

    def _show(self, decoded: DecodedModel) -> None:
        self._decoded, self._camera = decoded, decoded.model.call.camera
        # The modes of the default profile include the light inside the mouth.
        self._shade_mouth = decoded.model.call.profile == "thesis"
        self._renderer.set_texture(decoded.appearance.synthesise(np.zeros(0)))

    def _show_background(self) -> None:
        layers, grid_px = self._decoded.layers, self._decoded.mesh.grid_px
        self._renderer.set_background(layers.moving, grid_px, layers.static)

    def set_aau_offset(self, aau: Array, displacement_mm: Array | None = None) -> None:
        """Draw the caller with `aau` (len(AAUS),) added to their own AAUs from now on.

        displacement_mm: (n, 3) of the vertices besides, or None.
        """
        self._face = self._own_face.with_aau_offset(aau)
        if displacement_mm is not None:
            self._face = self._face.with_displacement(displacement_mm)

    def draw(self, face: FaceParameters, timer: StageTimer) -> Picture:
        """The picture of one frame, (height, width, 3) uint8 BGR."""
        self.submit(self.prepare(face, timer), timer)
        return self.read_back(timer)

    def prepare(self, face: FaceParameters, timer: StageTimer) -> FrameState:
        """Compute the state of a frame; the renderer may draw another one at the same time."""
        texture = None
        if self._decoded.appearance.changes:
            with timer.stage("texture"):
                lids = face.eau[LIDS]
                texture = self._decoded.appearance.synthesise(face.modes, lids)
        with timer.stage("animate"):
            vertices = self._face.animate(face.eau)
        with timer.stage("warp"):
            pose = pushed_before_camera(face.pose, vertices)
            own_motion = self._decoded.motion.own_motion(face.layers)
            grid_px = warp(self._decoded.mesh, pose, vertices, own_motion)
            shading = mouth_shading(self._decoded.head, vertices) if self._shade_mouth else None
            change = self._decoded.motion.change(face.layers)
            corners = self._decoded.motion.scene_corners(face.layers)
            light = self._decoded.motion.light(face.layers)
        return FrameState(pose, vertices, grid_px, shading, change, corners, light, texture)

    def submit(self, state: FrameState, timer: StageTimer) -> None:
        """Start drawing a frame; `read_back` returns its picture."""
        self._empty, self._submitted = None, state
        with timer.stage("render"):
            self._renderer.submit(self._camera, state, EDGE_EXPANSION_PX)

    def read_back(self, timer: StageTimer) -> Picture:
        """The picture of the frame submitted last, (height, width, 3) uint8 BGR."""
        with timer.stage("render"):
            return self._renderer.read_back()

    def face_area(self) -> Single:
        """Where the face is in the picture submitted last, see `face_area`."""
        assert self._submitted is not None
        state = self._submitted
        return face_area(self._decoded.head, self._camera, state.pose, state.vertices)

    def without_person(self, picture: Picture, presence: float) -> Picture:
        """A picture, read back last, of which the person fades: of 0 the scene alone is left.

        Where person and scene are one picture, it stays.
        """
        if self._decoded.layers.static is None:
            return picture
        if self._empty is None:
            self._empty = self._renderer.draw_scene()
        mixed = cv2.addWeighted(picture, presence, self._empty, 1 - presence, 0)
        return np.asarray(mixed, np.uint8)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


def pushed_before_camera(pose: Pose, vertices: Array) -> Pose:
    """The pose, moved away from the camera if a part of the head would be nearer than `NEAR_MM`.

    vertices: (n, 3) float64, mm, head frame.
    """
    nearest_mm = float(camera_from_head(pose, vertices)[:, 2].min())
    if nearest_mm >= NEAR_MM:
        return pose
    return Pose(pose.rotation, pose.translation_mm + np.array([0.0, 0.0, NEAR_MM - nearest_mm]))


def face_area(head: Head, camera: Camera, pose: Pose, vertices: Array) -> Single:
    """(height, width) 1 in the convex hull of the face's skin, 0 outside, in between at its edge.

    vertices: (n, 3) mm, head frame.
    """
    is_face = (head.opacity >= FACE_OPACITY) & (head.parts == PARTS.index("skin"))
    points = pixel_from_head(camera, pose, vertices[is_face])
    corners = cv2.convexHull(np.rint(np.clip(points, -1e4, 1e4)).astype(np.int32))
    area = np.zeros((camera.height, camera.width), np.float32)
    cv2.fillConvexPoly(area, corners, 1.0)
    side = 2 * max(1, round(SOFT_SHARE * max(area.shape))) + 1
    return np.asarray(cv2.blur(area, (side, side)), np.float32)


def mouth_shading(head: Head, vertices: Array) -> float:
    """Light inside the mouth, relative to that of wide open lips.

    vertices: (n, 3) float64, mm, head frame.
    """
    upper, lower = (vertices[head.landmarks[lip]] for lip in ("sto_upper", "sto_lower"))
    opening = smoothstep(np.linalg.norm(upper - lower) / OPEN_MOUTH_MM)
    return float(CLOSED_MOUTH_LIGHT + (1 - CLOSED_MOUTH_LIGHT) * opening)
