"""`risorius animate`: draws a script and writes its ground truth (thesis 5.3.1, 5.4.2).

Scene -> light -> blur -> noise -> video.  The head is the generic one with a painted skin, or that
of a call file.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from decoder.rendering.renderer import Renderer
from decoder.scene.decoded_model import decoded_model, face_from_model, head_of
from decoder.scene.reenactment import read_model
from decoder.scene.scene import Scene
from decoder.sinks.frame_sink import open_sink
from protocol.errors import ProtocolError
from protocol.model_packet import ModelPacket
from risorius.animation.animation_script import (
    SETTINGS,
    AnimationState,
    Script,
    read_script,
)
from risorius.animation.ground_truth import FrameGeometry, frame_truth, script_truth, write_truth
from risorius.animation.synthetic_skin import painted_colours
from shared_model.anatomy.muscle_fields import MuscleFields
from shared_model.animate import Face, Identity
from shared_model.arrays import Array, Picture, Single
from shared_model.errors import UserError, cannot_read
from shared_model.geometry import (
    FRONTAL,
    Camera,
    conjugate,
    multiply,
    normalise,
    pose_from_euler,
)
from shared_model.mesh import Head, generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, FaceParameters, Pose
from shared_model.stage_timer import StageTimer

# The jaw drops by no more at rest.
REST_JAW = 0.1
Progress = Callable[[int, int | None], None]

# Focal length of a script that names none, over the picture's longer side.
DEFAULT_FOCAL_RATIO = 1.4
# Settings of the generic head alone.
SETTINGS_OF_HEAD = ("width", "height", "distance_mm", "focal_px", "mottle")
# Light from one side dims the other side by at most this share.
SIDE_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class AnimateReport:
    """What was written: number of pictures, and the two files.

    unused: settings of the script that are without effect because a call has its own.
    """

    frames: int
    output: Path
    truth: Path
    unused: tuple[str, ...] = ()


class Actor(Protocol):
    """A head that can be drawn: the generic one, or that of a call file.

    rest_eau: (14,) the EAUs of its typical picture, the mouth closed; 0 of the generic one.
    """

    head: Head
    rest_eau: Array

    def geometry(self, state: AnimationState) -> FrameGeometry:
        """Camera, pose and vertices at this state."""

    def draw(self, state: AnimationState, geometry: FrameGeometry) -> Picture:
        """The picture of it, (height, width, 3) uint8 BGR, without light, blur and noise."""

    def close(self) -> None:
        """Free the renderer."""


def animate(
    script_file: Path,
    output: Path,
    progress: Progress,
    stop: Callable[[], bool],
    call_file: Path | None = None,
    truth: Path | None = None,
) -> AnimateReport:
    """Draw a script, a TOML file, to its end, or until `stop`.

    output: video or image pattern.  call_file: whose face; None: the generic head.
    truth: JSON file of the ground truth; None: next to the output.
    Raises `UserError` if it cannot be read, drawn or written.
    """
    script = read_script(script_file)
    truth = truth or _default_truth_path(output)
    frames: list[dict[str, Any]] = []
    with ExitStack() as stack:
        actor = open_actor(script, call_file)
        stack.callback(actor.close)
        camera = actor.geometry(script.at(0)).camera
        size = camera.width, camera.height
        sink = stack.enter_context(open_sink(output, *size, script.fps))
        random = np.random.default_rng(script.seed)
        for index in range(script.frames):
            if stop():
                break
            time_s = float(index / script.fps)
            state = script.at(time_s)
            geometry = actor.geometry(state)
            sink.write(degrade(actor.draw(state, geometry), script, state, random))
            frames.append(frame_truth(time_s, state, geometry, actor.head))
            progress(len(frames), script.frames)
    who = call_file.name if call_file else None
    names = {"script": script_file.name, "call": who, "video": output.name}
    write_truth(truth, {**names, **script_truth(script, camera)}, frames)
    unused = () if call_file is None else unused_settings(script)
    return AnimateReport(len(frames), output, truth, unused)


def unused_settings(script: Script) -> tuple[str, ...]:
    """Settings other than the default that a call's own person and camera leave without effect."""
    return tuple(name for name in SETTINGS_OF_HEAD if getattr(script, name) != SETTINGS[name][0])


class _Muscles:
    """The muscles of a head; their fields are computed where the first one contracts."""

    def __init__(self, head: Head) -> None:
        self._head = head
        self._fields: MuscleFields | None = None

    def displacement(self, state: AnimationState) -> Array:
        """(n, 3) mm of the muscles at this state."""
        if not state.muscles.any():
            return np.zeros_like(self._head.vertices)
        self._fields = self._fields or MuscleFields(self._head)
        return self._fields.displacement(state.muscles)


class GenericActor:
    """The generic head with a painted skin, before a plain or a given background."""

    def __init__(self, script: Script, head: Head) -> None:
        self.head, self._script = head, script
        self._muscles = _Muscles(head)
        self.rest_eau = np.zeros(len(EAUS))
        none = Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices))
        self._face = Face(head, none)
        focal = script.focal_px or DEFAULT_FOCAL_RATIO * max(script.width, script.height)
        self._camera = Camera(script.width, script.height, focal)
        self._colours = painted_colours(head, script.mottle, script.seed)
        self._renderer = Renderer(script.width, script.height, head, samples=4)
        self._background = _background(script)

    def geometry(self, state: AnimationState) -> FrameGeometry:
        """The camera zooms; the head keeps its distance."""
        home = Pose(np.array(FRONTAL), np.array([0.0, 0.0, self._script.distance_mm]))
        rest = self._camera
        camera = Camera(rest.width, rest.height, rest.focal_px * state.zoom)
        face = self._face.with_aau_offset(state.aau)
        vertices = face.with_displacement(self._muscles.displacement(state)).animate(state.eau)
        return FrameGeometry(camera, _pose_from_home(home, state), vertices)

    def draw(self, state: AnimationState, geometry: FrameGeometry) -> Picture:
        """The shaded head over the background."""
        drawn = self._renderer.draw_shaded(
            geometry.camera, geometry.pose, geometry.vertices, self._colours
        )
        if self._background is None:
            return drawn
        # Black paint on the renderer's grey tells how much of each pixel the head covers.
        black = np.zeros_like(self._colours)
        mask = self._renderer.draw_shaded(geometry.camera, geometry.pose, geometry.vertices, black)
        open_share = mask.astype(np.float32) / max(int(mask.max()), 1)
        mixed = drawn - open_share * mask.max() + open_share * self._background
        return np.asarray(np.clip(np.rint(mixed), 0, 255), dtype=np.uint8)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


class CallerActor:
    """The person of a call as the decoder draws them: shape, texture, camera, still background."""

    def __init__(self, model: ModelPacket) -> None:
        self.head, self._model = head_of(model), model
        self._muscles = _Muscles(self.head)
        self.rest_eau = model.reference_face.eau
        # Whoever speaks in their typical picture has the mouth closed at rest.
        jaw = EAU_INDEX["jaw_drop"]
        self.rest_eau[jaw] = min(self.rest_eau[jaw], REST_JAW)
        self._face = face_from_model(model, self.head)
        self._scene = Scene(decoded_model(model))
        self._timer = StageTimer()

    def geometry(self, state: AnimationState) -> FrameGeometry:
        """Poses are relative to the reference pose of the call, AAUs to the person's own."""
        pose = _pose_from_home(self._model.reference_pose, state)
        face = self._face.with_aau_offset(state.aau)
        vertices = face.with_displacement(self._muscles.displacement(state)).animate(state.eau)
        return FrameGeometry(self._model.call.camera, pose, vertices)

    def draw(self, state: AnimationState, geometry: FrameGeometry) -> Picture:
        """As the decoder draws a frame of a call."""
        self._scene.set_aau_offset(state.aau, self._muscles.displacement(state))
        return self._scene.draw(FaceParameters(geometry.pose, state.eau), self._timer)

    def close(self) -> None:
        """Free the renderer."""
        self._scene.close()


def degrade(
    picture: Picture, script: Script, state: AnimationState, random: np.random.Generator
) -> Picture:
    """What the camera adds: light, then blur, then noise; (h, w, 3) uint8 in and out."""
    light = state.brightness * side_light(picture.shape[1], state.side)
    value = picture.astype(np.float32) * light[None, :, None]
    if script.blur_px:
        value = cv2.GaussianBlur(value, (0, 0), script.blur_px)
    if script.noise:
        value = value + script.noise * random.standard_normal(value.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(value), 0, 255), dtype=np.uint8)


def side_light(width: int, side: float) -> Single:
    """(width,) gain of light from the picture's left (side -1) or right (+1); 1 in the middle."""
    return (1 + side * SIDE_SHARE * np.linspace(-1, 1, width)).astype(np.float32)


def open_actor(script: Script, call_file: Path | None) -> Actor:
    """The actor of a script: the generic head, or the person of a call file.

    Raises `UserError` if that person cannot be drawn, or if the script sets what a call file sets.
    """
    if call_file is None:
        return GenericActor(script, generic_head())
    own = ["camera"] if any(group == "camera" for group, _ in script.tracks) else []
    own += ["background"] if script.background else []
    if own:
        what = " and ".join(own)
        raise UserError(f"a call has its own {what}: leave that out of the script")
    try:
        return CallerActor(read_model(call_file))
    except ProtocolError as error:
        raise UserError(f"cannot draw {call_file}: {error}") from error


def _pose_from_home(home: Pose, state: AnimationState) -> Pose:
    """The home pose, turned in the head's own axes and moved in the camera's."""
    pose = state.pose
    turned = pose_from_euler(pose["pitch"], pose["yaw"], pose["roll"], np.zeros(3)).rotation
    local = multiply(conjugate(np.array(FRONTAL)), turned)
    moved = home.translation_mm + np.array([pose["right"], pose["down"], pose["away"]])
    if moved[2] < 100:
        raise UserError(f"the script brings the head to {moved[2]:.0f} mm from the camera")
    return Pose(normalise(multiply(home.rotation, local)), moved)


def _background(script: Script) -> Single | None:
    if script.background is None:
        return None
    try:
        data = script.background.read_bytes()
    except OSError as error:
        raise cannot_read(script.background, error) from error
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if picture is None:
        raise UserError(f"the background {script.background} is not a picture OpenCV can read")
    size = (script.width, script.height)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _default_truth_path(output: Path) -> Path:
    """The truth's place: out.mkv -> out.json, out/%04d.png -> out/truth.json."""
    return output.with_name("truth.json") if "%" in output.name else output.with_suffix(".json")
