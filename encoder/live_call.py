"""The default profile of a live source, sending side: every frame is sent as it comes.

The first face makes the first model packet: shape, mean texture, no modes.  As the call teaches
what the caller looks like, the model is learned again and goes out as an update, announced some
packets before the first frame packet that needs it; the stream flows on meanwhile.

On a thin link the first model is a first layer only.  Of an update the first layers go ahead, its
model packet once they make it better than what there is, then the other modes.
"""

from collections.abc import Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from encoder.cadence import Cadence
from encoder.capture import Capture
from encoder.combine import combine, harm_matrix, project
from encoder.crop import crop_face
from encoder.default_call import send_layers, send_model, warn_of_missing
from encoder.detect import BlazeFaceDetector
from encoder.fit import (
    LandmarkModel,
    fit_frame,
    landmark_model,
    personalise,
    start_parameters,
)
from encoder.imagine import imagined
from encoder.landmarks import LandmarkTracker
from encoder.model import Budget, call_parameters
from encoder.networks import find_network_folder
from encoder.rate import LivePurse, Spending
from encoder.startup import UPDATE_LAYER_BYTES, LayerPacer, layered
from encoder.tally import Tally
from encoder.texture import code_background
from encoder.two_pass import Learned, Sampler, default_model, follow_all, learn_caller
from protocol.components import Components, vector_from_face
from protocol.link import PacketSink
from protocol.messages import (
    SEQUENCE_MODULUS,
    CallParameters,
    ControlKind,
    ControlPacket,
    FramePacket,
    ModelPacket,
)
from protocol.predict import FramePredictor
from shared_model.parameters import FaceParameters
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# Seconds of the caller's face after which the model is learned, and what share of the budget for
# texture and modes it takes: nobody keeps the first ones for long.
LEARN_AFTER_S = {1.0: 0.6, 3.0: 1.0, 6.0: 1.0, 10.0: 1.0, 16.0: 1.0, 25.0: 1.0, 40.0: 1.0}
# Frames to learn from, and up to twice as many: learning goes on beside the call.
TRAINING_FRAMES = 24
# Packets by which an update is announced ahead of its first frame packet, at least and at most:
# any farther, its sequence number would pass for one before.
AHEAD, MOST_AHEAD = 4, SEQUENCE_MODULUS // 2 - 1
# Layers that make an update better than the model before: texture, background and four modes.
ENOUGH_ITEMS = 6
# What of the budget the first model takes: its still, and a mean that is soon replaced.
FIRST_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class Epoch:
    """A model packet, and what is needed to send frames under it.

    number: of its first frame packet in the call.
    """

    model: ModelPacket
    learned: Learned
    landmarks: LandmarkModel
    components: Components
    harm: Array
    number: int


class LiveCall:
    """A call in the default profile, sent frame by frame.

    look_for_face_s: say so if there is no face after this many seconds of video.
    wait: learn before the next frame, so that the same source gives the same bytes; otherwise
        beside the frames.
    pacer: sends models in layers; None: whole, at once.
    """

    def __init__(
        self,
        capture: Capture,
        sink: PacketSink,
        budget: Budget,
        bitrate: float,
        look_for_face_s: float,
        tally: Tally,
        wait: bool,
        cadence: Cadence,
        pacer: LayerPacer | None = None,
    ) -> None:
        folder = find_network_folder()
        self._tracker = LandmarkTracker(folder, BlazeFaceDetector(folder))
        self._capture, self._sink, self._tally = capture, sink, tally
        self._budget, self._look_for_face_s = budget, look_for_face_s
        self._head = surrounded_head()
        self._sampler, self._points = Sampler(TRAINING_FRAMES), dict[int, Array]()
        self._faces_seen = 0
        self._due = list(LEARN_AFTER_S.items())
        self._pool: Executor | None = None if wait else ThreadPoolExecutor(1)
        # More would take the cores from the frames.
        self._workers = None if wait else 1
        self._learning: Future[Learned] | None = None
        self._epoch: Epoch | None = None
        self._next: Epoch | None = None
        self._pacer = pacer
        self._coming: Epoch | None = None  # whose layers are on their way
        self._background = b""
        self._face: FaceParameters | None = None  # as it was last seen
        self._missed = 0  # frames without the face since one was last coded
        self._held = 0  # frames waiting that repeat an older face
        self._lost = False  # whether the decoder has been told
        self._number = 0  # of the next frame packet
        self._coded = 0  # source frames coded so far
        self._waiting: list[Array] = []
        self._predictor = FramePredictor(np.zeros((1, 5), np.uint8))
        self._cadence, self._fps = cadence, float(capture.fps)
        self._still: Picture = np.zeros((0, 0, 3), np.uint8)
        fps = float(cadence.coded_fps(capture.fps))
        spending = Spending(bitrate, fps, cadence.frames_per_packet)
        self._purse = LivePurse(spending)

    @property
    def started(self) -> bool:
        """Whether a face has been found yet."""
        return self._epoch is not None

    def frame(self, index: int, frame: Picture) -> None:
        """Find the face in source frame `index` and send what is due."""
        with self._tally.stage("landmarks"):
            found = self._tracker.update(frame)
        if self._tracker.faces_seen > 1:
            self._tally.warn(f"{self._tracker.faces_seen} faces in the picture: taking the largest")
        if found is None:
            self._miss(index)
            return
        number = self._faces_seen
        self._faces_seen += 1
        self._sampler.offer(number, frame.copy)
        self._points[number] = found.points
        if self._epoch is None:
            self._begin(index)
        epoch = self._epoch
        assert epoch is not None
        if self._is_coded(index):
            if self._missed:
                self._face = None
            self._missed = 0
            self._queue(self._refined(epoch, frame, found.points))
        self._learn_on(index)

    def end(self, frames: int) -> None:
        """Close a call of `frames` source frames."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        if self._epoch is not None:
            self._flush()
            if self._pacer is not None:
                warn_of_missing(self._pacer, self._tally)
                if self._epoch.model.layer == 0:
                    self._tally.warn("the call ended with no more of its model than a first layer")
            self._tally.send(self._sink, ControlPacket(0, ControlKind.END, frames))

    def _miss(self, index: int) -> None:
        self._tally.lost_frames += 1
        if self._epoch is None:
            if index / self._capture.fps >= self._look_for_face_s:
                self._tally.warn(f"no face in the first {self._look_for_face_s:g} s; still looking")
            return
        assert self._face is not None
        self._missed += 1
        if self._is_coded(index):
            self._held += 1
            self._queue(self._face)

    def _is_coded(self, index: int) -> bool:
        return index == self._coded + len(self._waiting) * self._cadence.frame_step

    def _refined(self, epoch: Epoch, frame: Picture, points: Array) -> FaceParameters:
        """The caller in one frame, by landmarks, then by the learned appearance."""
        camera, caller = epoch.model.call.camera, epoch.learned.caller
        with self._tally.stage("fit"):
            near = self._face or start_parameters(epoch.landmarks, camera, points)
            start = fit_frame(epoch.landmarks, camera, points, near)
        with self._tally.stage("refine"):
            crop = crop_face(frame, points, caller.pixels_per_texel)
            self._face = caller.tracker.refine(crop, start, 3)
        return self._face

    def _queue(self, face: FaceParameters) -> None:
        """Add a frame to the packet that is being filled, and send it once it is full."""
        epoch = self._epoch
        assert epoch is not None
        vector = vector_from_face(face, epoch.model.reference_pose)
        self._waiting.append(project(epoch.components, vector[None], epoch.harm)[0])
        first = self._number == epoch.number
        if len(self._waiting) == (1 if first else self._cadence.frames_per_packet):
            self._flush()

    def _flush(self) -> None:
        epoch = self._epoch
        assert epoch is not None
        if not self._waiting:
            return
        lost = self._held == len(self._waiting)
        if lost != self._lost:
            kind = ControlKind.LOST if lost else ControlKind.FOUND
            self._tally.send(self._sink, ControlPacket(0, kind, self._coded))
            self._lost = lost
        number = self._number - epoch.number
        with self._tally.stage("code"):
            packet = self._purse.code(self._predictor, number, np.array(self._waiting))
        self._predictor.anchor = packet.frames[-1]
        self._tally.frame_bytes += len(packet.payload)
        sequence = self._number % SEQUENCE_MODULUS
        self._tally.send(self._sink, FramePacket(sequence, packet.payload))
        frames = len(self._waiting)
        self._coded += frames * self._cadence.frame_step
        self._waiting.clear()
        self._held = 0
        self._number += 1
        if self._next is not None and self._number == self._next.number:
            self._enter(self._next)
            self._next = None
        if self._pacer is not None:
            seconds = frames * self._cadence.frame_step / self._fps
            self._send_layers(self._pacer, 1 + len(packet.payload), seconds)

    def _enter(self, epoch: Epoch) -> None:
        """Frames from here on are sent under `epoch`."""
        self._epoch = epoch
        self._predictor = FramePredictor(epoch.components.spreads)
        if self._face is not None:
            # Coefficients are of other modes now; the mean until the next refinement.
            blank = np.zeros(len(epoch.components.modes))
            self._face = replace(self._face, modes=blank)

    def _begin(self, index: int) -> None:
        """The first face: a model from this frame alone."""
        share = replace(
            self._budget, face_bytes=int(self._budget.face_bytes * FIRST_SHARE), most_modes=0
        )
        self._still = self._sampler.frames[0][1]
        self._background = code_background(self._still, self._budget.background_bytes)
        learned = self._learn(share, *self._sample())
        self._coded = index
        epoch = self._epoch_of(learned, layer=0, number=0, start=index)
        if self._pacer is not None:
            # What else the first frame could teach, the update does better and is as large.
            parts = layered(epoch.model, learned.caller.appearance.mean, self._still)
            epoch = replace(epoch, model=parts.first)
        self._send_model(epoch)
        self._enter(epoch)

    def _learn_on(self, index: int) -> None:
        """Learn again when it is time; announce what was learned."""
        if self._learning is not None:
            if self._learning.done():
                learned, self._learning = self._learning.result(), None
                self._announce(learned)
        elif self._due and self._next is None and not self._sending_layers:
            after_s, share = self._due[0]
            if self._faces_seen < after_s * self._capture.fps:
                return
            self._due.pop(0)
            # While layers were sent more than one may have become due.
            while self._pacer and self._due and self._faces_seen >= self._due[0][0] * self._fps:
                share = self._due.pop(0)[1]
            budget = replace(self._budget, face_bytes=int(share * self._budget.face_bytes))
            if self._pool is None:
                with self._tally.stage("learn"):
                    self._announce(self._learn(budget, *self._sample()))
            else:
                self._learning = self._pool.submit(self._learn, budget, *self._sample())

    def _announce(self, learned: Learned) -> None:
        epoch = self._epoch
        assert epoch is not None
        layer = epoch.model.layer + 1
        if self._pacer is None:
            self._next = self._epoch_of(learned, layer, *self._ahead(AHEAD))
            self._send_model(self._next)
            return
        draft = self._epoch_of(learned, layer, 0, 0)
        mean = learned.caller.appearance.mean
        parts = layered(draft.model, mean, self._still, UPDATE_LAYER_BYTES)
        self._pacer.begin(parts)
        self._coming = replace(draft, model=parts.first)

    def _ahead(self, packets: int) -> tuple[int, int]:
        """Number and first source frame of the frame packet that comes after so many."""
        epoch, cadence = self._epoch, self._cadence
        frames = packets * cadence.frames_per_packet
        if epoch is not None and self._number == epoch.number:
            # Its first packet, which is yet to be sent, holds one frame.
            frames -= cadence.frames_per_packet - 1
        return self._number + packets, self._coded + frames * cadence.frame_step

    @property
    def _sending_layers(self) -> bool:
        return self._coming is not None or (self._pacer is not None and self._pacer.busy)

    def _send_layers(self, pacer: LayerPacer, frame_bytes: int, seconds: float) -> None:
        """Send the layers that are due; once there are enough of an update, its model packet."""
        send_layers(pacer, frame_bytes, seconds, self._sink, self._tally)
        coming = self._coming
        if coming is None or (pacer.items_sent < ENOUGH_ITEMS and pacer.items_waiting):
            return
        cadence = self._cadence
        packet_s = cadence.frames_per_packet * cadence.frame_step / self._fps
        carried_s = pacer.carried_s(UPDATE_LAYER_BYTES)
        number, start = self._ahead(packets_ahead(carried_s, packet_s))
        call = replace(coming.model.call, start_frame=start)
        model = replace(coming.model, call=call, sequence=number % SEQUENCE_MODULUS)
        self._next, self._coming = replace(coming, model=model, number=number), None
        self._send_model(self._next)

    def _send_model(self, epoch: Epoch) -> None:
        send_model(epoch.model, self._sink, self._tally, self._pacer)

    def _sample(self) -> tuple[list[Picture], list[Array]]:
        """Some of the frames so far, and their landmarks."""
        self._points = {number: self._points[number] for number, _ in self._sampler.frames}
        return [frame for _, frame in self._sampler.frames], list(self._points.values())

    def _learn(
        self, budget: Budget, pictures: Sequence[Picture], points: Sequence[Array]
    ) -> Learned:
        """Identity and appearance from some frames and their landmarks."""
        size = (self._capture.width, self._capture.height)
        fitted, faces = follow_all(self._head, size, points)
        call = self._call_parameters(fitted.camera.focal_px, 0)
        frames = list(enumerate(pictures))
        return learn_caller(self._head, fitted, faces, frames, points, call, budget, self._workers)

    def _epoch_of(self, learned: Learned, layer: int, number: int, start: int) -> Epoch:
        caller = learned.caller
        pose = caller.reference.pose
        every = max(1, len(learned.crops) // 12)
        harm = harm_matrix(caller.tracker, learned.crops[::every], learned.faces[::every], pose)
        vectors = np.array([vector_from_face(face, pose) for face in learned.faces])
        cadence, modes = self._cadence, caller.appearance.modes
        motion = imagined(vectors, cadence.frame_step)
        components = combine(motion, harm, modes, cadence.frames_per_packet)
        call = self._call_parameters(caller.fitted.camera.focal_px, start)
        packet = default_model(caller, components, call, self._background)
        model = replace(packet, layer=layer, layers=layer + 1, sequence=number % SEQUENCE_MODULUS)
        landmarks = personalise(
            landmark_model(self._head), caller.fitted.identity.aau, caller.fitted.control_mm
        )
        return Epoch(model, learned, landmarks, components, harm, number)

    def _call_parameters(self, focal_px: float, start: int) -> CallParameters:
        packing = self._cadence.frames_per_packet, self._cadence.frame_step
        return call_parameters(self._capture, "default", focal_px, start, *packing)


def packets_ahead(carried_s: float, packet_s: float) -> int:
    """How many packets of `packet_s` ahead to announce what takes the link `carried_s`."""
    return min(AHEAD + ceil(carried_s / packet_s), MOST_AHEAD)
