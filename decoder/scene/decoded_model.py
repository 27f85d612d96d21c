"""What a scene is drawn from, decoded from a model packet: all that needs no renderer.

A well-formed model packet may describe a face that cannot be drawn: it is refused here.
A model takes longer to decode than a frame.  `ModelLoader` does it beside the frames, as soon as
the model has been received.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import count
from threading import Condition

import numpy as np

from decoder.rendering.render_geometry import NEAR_MM
from decoder.scene.appearance import FrameTextures, go_on
from decoder.scene.background_layers import BackgroundLayers, load_background
from decoder.scene.layer_motion import LayerMotion
from protocol.errors import ProtocolError
from protocol.frames.scalar_quantiser import AAU_STEP, RESIDUAL_STEP_MM, values_from_codes
from protocol.model_packet import ModelPacket
from protocol.pictures.foreground_mask import decode_mask
from protocol.pictures.picture_codec import decode_picture, serialise_picture_header
from protocol.pictures.probability_model import TEXTURE
from protocol.progressive_model import is_same_model
from shared_model.animate import Face, identity_from_controls
from shared_model.arrays import Array
from shared_model.geometry import Camera, camera_from_head
from shared_model.layers.head_motion import (
    BackgroundMesh,
    make_background_mesh,
    projected_face_width_px,
)
from shared_model.mesh import Head, generic_head
from shared_model.parameters import Pose
from shared_model.shape_residual import residual_basis
from shared_model.surround import head_with_surround

# A picture takes 3 bytes a pixel, its buffers 8, and several pictures are queued.
MAX_PICTURE_PX = 4096 * 4096
# Narrower faces in the background picture are refused.
MIN_FACE_WIDTH_PX = 4.0
# The decoded models that may be asked for again: in use and to come, of the call and another face.
KEPT_MODELS = 4
# Side of the picture that the decoder is warmed up with.
WARM_UP_PX = 64


@dataclass(frozen=True, slots=True)
class DecodedModel:
    """A model packet, with the layers applied so far, and what is drawn of it.

    damages: what was wrong with further layers of the model; they are not drawn.
    """

    model: ModelPacket
    head: Head
    face: Face
    appearance: FrameTextures
    mesh: BackgroundMesh
    layers: BackgroundLayers
    motion: LayerMotion
    damages: tuple[ProtocolError, ...] = ()


def decoded_model(
    model: ModelPacket,
    before: DecodedModel | None = None,
    give_way: Callable[[], None] = go_on,
) -> DecodedModel:
    """Decode a model.

    before: an earlier model; what has not changed since is taken over.
    give_way: called before each picture; waits while what is more urgent is decoded.
    Raises `ProtocolError` if the model cannot be drawn.
    """
    if before is not None and is_same_model(before.model, model):
        return _with_more_layers(before, model, give_way)
    camera, head = model.call.camera, head_of(model)
    check_size(camera)
    face = face_from_model(model, head)
    rest = face.animate(model.reference_face.eau)
    check_reference(camera, model.reference_pose, head, rest)
    appearance = FrameTextures(model, give_way)
    give_way()
    if before is not None and _background(before.model) == _background(model):
        layers = before.layers
    else:
        layers = load_background(model.background, camera.width, camera.height)
    mesh = make_background_mesh(camera, model.reference_pose, head, rest)
    return DecodedModel(model, head, face, appearance, mesh, layers, LayerMotion(mesh, layers))


def _with_more_layers(
    before: DecodedModel, model: ModelPacket, give_way: Callable[[], None]
) -> DecodedModel:
    """The model with further layers of it; those that are damaged are left out."""
    appearance, damage = before.appearance.updated(model, give_way)
    damages = before.damages if damage is None else (*before.damages, damage)
    decoded = replace(before, model=model, appearance=appearance, damages=damages)
    if model.background == before.model.background:
        return decoded
    try:
        layers = load_background(model.background, model.call.width, model.call.height)
    except ProtocolError as error:
        return replace(decoded, damages=(*damages, error))
    return replace(decoded, layers=layers, motion=LayerMotion(before.mesh, layers))


def _background(model: ModelPacket) -> tuple[int, int, bytes]:
    return model.call.width, model.call.height, model.background


Decode = Callable[[ModelPacket, DecodedModel | None, Callable[[], None]], DecodedModel]


@dataclass(eq=False, slots=True)
class _Job:
    """A model that is decoded or has been.

    used: a count, when it was decoded or asked for last.
    """

    model: ModelPacket
    used: int
    future: "Future[DecodedModel]" = field(default_factory=Future)

    def decoded(self) -> DecodedModel | None:
        """The decoded model, if it is there."""
        is_there = self.future.done() and self.future.exception() is None
        return self.future.result() if is_there else None


class ModelLoader:
    """Decodes models beside the frames, each once, in the order in which they are asked for.

    Further layers of a model, whose frames may have come, do not wait for a model that follows:
    they have a thread of their own, to which that of the model gives way between two pictures.
    load: as `decoded_model`.
    """

    def __init__(self, load: Decode = decoded_model) -> None:
        self._load, self._uses = load, count()
        self._of_models, self._of_layers = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        # Layers that are decoded or could be; for any thread.
        self._layers_asked, self._is_closed, self._changed = 0, False, Condition()
        self._jobs: tuple[_Job, ...] = ()  # in the order in which they were begun

    def warm_up(self) -> None:
        """Do what takes long the first time, before a model is there."""
        self._of_models.submit(load_loops)

    def request(self, model: ModelPacket) -> "Future[DecodedModel]":
        """Begin to decode a model, unless that has been done."""
        for known in reversed(self._jobs):
            if known.model is model:
                known.used = next(self._uses)
                return known.future
        alike = [job for job in self._jobs if is_same_model(job.model, model)]
        job = _Job(model, next(self._uses))
        job.future.add_done_callback(lambda _: setattr(job, "used", next(self._uses)))
        done = [each for each in self._jobs if each.future.done()]
        dropped = sorted(done, key=lambda each: each.used)[:-KEPT_MODELS]
        self._jobs = (*(each for each in self._jobs if each not in dropped), job)
        if alike:
            # Not after models that were asked for meanwhile.
            alike[-1].future.add_done_callback(lambda _: self._start(job, self._of_layers))
        else:
            self._start(job, self._of_models)
        return job.future

    def get(self, model: ModelPacket) -> DecodedModel:
        """A model, decoded; waits for that.  Raises `ProtocolError` as `decoded_model`."""
        return self.request(model).result()

    def close(self) -> None:
        """End the threads."""
        with self._changed:
            self._is_closed = True
        for lane in (self._of_layers, self._of_models):
            lane.shutdown(cancel_futures=True)

    def _start(self, job: _Job, lane: ThreadPoolExecutor) -> None:
        """Let a thread decode the model of a job, what that builds on being decoded."""
        with self._changed:
            if self._is_closed:
                return
            is_layers = lane is self._of_layers
            self._layers_asked += is_layers
            task = lane.submit(self._run, job, go_on if is_layers else self._give_way)
        if is_layers:
            task.add_done_callback(lambda _: self._end_layers())

    def _end_layers(self) -> None:
        with self._changed:
            self._layers_asked -= 1
            self._changed.notify_all()

    def _give_way(self) -> None:
        """Wait while further layers are decoded."""
        with self._changed:
            self._changed.wait_for(lambda: not self._layers_asked)

    def _run(self, job: _Job, give_way: Callable[[], None]) -> None:
        before = [decoded for each in self._jobs if (decoded := each.decoded()) is not None]
        alike = [decoded for decoded in before if is_same_model(decoded.model, job.model)]
        try:
            job.future.set_result(self._load(job.model, [None, *before, *alike][-1], give_way))
        except Exception as error:  # for whoever asks for the model
            job.future.set_exception(error)


def load_loops() -> None:
    """Read the head, and decode a mask and a picture of zeros: that loads the compiled loops."""
    residual_basis(head_with_surround())
    decode_mask(b"")
    header = serialise_picture_header(TEXTURE, WARM_UP_PX, WARM_UP_PX, b"")
    with suppress(ProtocolError):
        decode_picture("warm-up", header + bytes([0]))


def head_of(model: ModelPacket) -> Head:
    """The head mesh of the call's profile."""
    return head_with_surround() if model.call.profile == "default" else generic_head()


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
