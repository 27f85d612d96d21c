"""The default profile of a recorded source, sending side: survey, learn, refine, code, send."""

import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from encoder.calls.session_stats import Tally
from encoder.capture.face_crop import Crop, crop_face
from encoder.capture.video_source import Capture
from encoder.coding.background import Still, still_of
from encoder.coding.gop import Cadence
from encoder.coding.model_packet import Budget, call_parameters
from encoder.coding.progressive_model import LayeredModel, LayerPacer, layered
from encoder.coding.rate_control import Spending, code_call, packet_bits, packet_spans
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmark_indices import outline_of
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import NetworkFilesMissing, find_network_folder
from encoder.fitting.render_and_compare import drawing_of
from encoder.learning.person_model import Learned, learn_caller
from encoder.learning.two_pass import (
    Sampler,
    combine_call,
    default_model,
    follow_all,
    smoothed,
)
from encoder.runtime.parallel import workers_beside
from protocol.link.interface import PacketSink
from protocol.packets import (
    SEQUENCE_MODULUS,
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    ModelPacket,
    serialise,
)
from shared_model.errors import UserError
from shared_model.parameters import FaceParameters
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


# Frames of the second pass that are read ahead of the one whose face is taken next.
MOST_WAITING = 32


@dataclass(frozen=True, slots=True)
class CodedCall:
    """A whole call: model packet, frame payloads, number of source frames; where no face was."""

    model: ModelPacket
    payloads: tuple[bytes, ...]
    frames: int
    lost: frozenset[int]


class Survey:
    """Goes over a source twice and ends with a coded call.

    Call `frame` with every frame, `learn`, `refine` with every frame again, then `code`.
    """

    def __init__(self, capture: Capture, tally: Tally, cadence: Cadence) -> None:
        try:
            folder = find_network_folder()
        except NetworkFilesMissing as error:
            raise UserError(f"{error}; without them use --profile thesis") from error
        # The caller's own appearance says more of the lids, once it is learned.
        self._tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), look_at_lids=False)
        self._capture, self._tally, self._cadence = capture, tally, cadence
        self._points: list[Array] = []
        self._number: dict[int, int] = {}  # source frame -> place among those with a face
        self._frames = 0
        self._sampler = Sampler()
        self._still: Still | None = None
        self._learned: Learned | None = None
        self._start: list[FaceParameters] = []
        self._coded: list[int] = []  # whose face each coded frame has, by place
        self._needed: frozenset[int] = frozenset()
        self._faces: dict[int, FaceParameters] = {}

    @property
    def faces_seen(self) -> int:
        """Number of frames with a face so far."""
        return len(self._points)

    @property
    def faces_refined(self) -> int:
        """Number of them that `refine` has found."""
        return len(self._faces)

    def frame(self, index: int, frame: Picture, coming: Picture | None = None) -> None:
        """First pass over source frame `index`: where are the landmarks.

        coming: see `LandmarkTracker.update`.
        """
        with self._tally.stage("landmarks"):
            found = self._tracker.update(frame, coming)
        self._frames = index + 1
        if self._tracker.faces_seen > 1:
            self._tally.warn(f"{self._tracker.faces_seen} faces in the picture: taking the largest")
        if found is None:
            self._tally.lost_frames += 1
            return
        if self._still is None:
            self._still = still_of(frame, outline_of(found.points))
        self._number[index] = len(self._points)
        self._sampler.offer(len(self._points), lambda: frame)
        self._points.append(found.points)

    def learn(self, budget: Budget) -> None:
        """Between the passes: identity, appearance model."""
        head = surrounded_head()
        size = (self._capture.width, self._capture.height)
        with self._tally.stage("fit"):
            fitted, self._start = follow_all(head, size, list(smoothed(np.array(self._points))))
        focal_px, start, cadence = fitted.camera.focal_px, min(self._number), self._cadence
        held = held_numbers(self._number, start, max(self._number) + 1)
        self._coded = held[:: cadence.frame_step]
        self._needed = frozenset(self._coded)
        call = call_parameters(
            self._capture,
            "default",
            focal_px,
            start,
            cadence.frames_per_packet,
            cadence.frame_step,
        )
        with self._tally.stage("learn"):
            self._learned = learn_caller(
                head, fitted, self._start, self._sampler.frames, self._points, call, budget
            )
        caller = self._learned.caller
        self._drawing = drawing_of(caller.face, call.camera, caller.appearance)
        self._call, self._budget = call, budget

    def refine(self, frames: Iterable[tuple[int, Picture]]) -> None:
        """Second pass, over source frames (index, picture): find the face in all to be coded.

        Frames are read while those before them are refined.
        """
        assert self._learned is not None
        caller, drawing = self._learned.caller, self._drawing

        def find(number: int, crop: Crop) -> FaceParameters:
            found = caller.tracker.refine(crop, self._start[number], 3)
            return drawing.fit(crop, found, outline_of(self._points[number]))

        waiting = deque[tuple[int, Future[FaceParameters]]]()
        with workers_beside() as pool:
            for index, frame in frames:
                number = self._number.get(index)
                if number is None or number not in self._needed:
                    continue
                if len(waiting) == MOST_WAITING:
                    self._take(*waiting.popleft())
                with self._tally.stage("crop"):
                    crop = crop_face(frame, self._points[number], caller.pixels_per_texel)
                waiting.append((number, pool.submit(find, number, crop)))
            for each in waiting:
                self._take(*each)

    def _take(self, number: int, found: Future[FaceParameters]) -> None:
        with self._tally.stage("refine"):
            self._faces[number] = found.result()

    def code(self, bitrate: float) -> CodedCall:
        """The call at `bitrate` bits per second, all frame packets counted."""
        assert self._learned is not None and self._still is not None
        start, cadence = self._call.start_frame, self._cadence
        coded = list(takewhile(self._faces.__contains__, self._coded))
        stopped_at = start + (len(coded) - 1) * cadence.frame_step + 1
        frames = self._frames if len(coded) == len(self._coded) else stopped_at
        place = {number: i for i, number in enumerate(self._faces)}
        with self._tally.stage("combine"):
            faces = list(self._faces.values())
            components, values = combine_call(self._learned, faces, cadence.frames_per_packet)
            background = self._still.coded(self._budget.background_bytes)
            model = default_model(self._learned.caller, components, self._call, background)
        fps = float(cadence.coded_fps(self._capture.fps))
        spending = Spending(bitrate, fps, cadence.frames_per_packet)
        with self._tally.stage("code"):
            sent = values[[place[number] for number in coded]]
            packets = code_call(sent, components.spreads, spending)
        if excess := spending.excess(sum(map(packet_bits, packets)), len(sent)):
            self._tally.warn(excess)
        lost = frozenset(set(range(start, frames)) - set(self._number))
        return CodedCall(model, tuple(p.payload for p in packets), frames, lost)

    def in_layers(self, call: CodedCall) -> LayeredModel:
        """The model of a call as it is sent in layers."""
        assert self._learned is not None and self._still is not None
        return layered(call.model, self._learned.caller.appearance.mean, self._still)


def held_numbers(number: dict[int, int], start: int, end: int) -> list[int]:
    """For each source frame from `start` to `end`, the newest of the found faces until then."""
    held, last = [], number[start]
    for index in range(start, end):
        last = number.get(index, last)
        held.append(last)
    return held


def send_call(
    call: CodedCall,
    sink: PacketSink,
    tally: Tally,
    fps: float | None,
    stop: Callable[[], bool],
    pacer: LayerPacer | None = None,
) -> None:
    """Send a coded call, as fast as it goes or at `fps` source frames per second.

    pacer: says which layers of the call's model to send between frame packets.
    """
    send_model(call.model, sink, tally, pacer)
    begin, parameters = time.monotonic(), call.model.call
    start, step = parameters.start_frame, parameters.frame_step
    spans = packet_spans(len(range(start, call.frames, step)), parameters.frames_per_packet)
    lost, frames = False, call.frames
    for number, (payload, (first, end)) in enumerate(zip(call.payloads, spans, strict=False)):
        if number and stop():
            frames = start + first * step
            break
        if fps is not None:
            newest = start + (end - 1) * step
            time.sleep(max(0.0, begin + (newest + 1) / fps - time.monotonic()))
        gone = all(start + i * step in call.lost for i in range(first, end))
        if gone != lost:
            kind = ControlKind.LOST if gone else ControlKind.FOUND
            tally.send(sink, ControlPacket(0, kind, start + first * step))
            lost = gone
        tally.frame_bytes += len(payload)
        tally.send(sink, FramePacket(number % SEQUENCE_MODULUS, payload))
        if pacer is not None:
            seconds = (end - first) * step / parameters.fps
            send_layers(pacer, 1 + len(payload), seconds, sink, tally)
    if pacer is not None:
        warn_of_missing(pacer, tally)
    tally.send(sink, ControlPacket(0, ControlKind.END, frames))
    tally.frames = frames


def send_model(
    model: ModelPacket, sink: PacketSink, tally: Tally, pacer: LayerPacer | None
) -> None:
    """Send a model packet, whole or the first layer of one."""
    size = send_part(model, sink, tally)
    if pacer is not None:
        pacer.spent(size)


def send_part(packet: ModelPacket | LayerPacket, sink: PacketSink, tally: Tally) -> int:
    """Send what counts as model; returns its bytes."""
    size = len(serialise(packet))
    tally.model_bytes += size - 1
    tally.send(sink, packet)
    return size


def send_layers(
    pacer: LayerPacer, frame_bytes: int, seconds: float, sink: PacketSink, tally: Tally
) -> None:
    """Send the layers that are due after a frame packet of so many bytes and seconds."""
    pacer.spent(frame_bytes)
    for layer in pacer.due(seconds):
        send_part(layer, sink, tally)


def warn_of_missing(pacer: LayerPacer, tally: Tally) -> None:
    """Say so if a call ends before its model was sent whole."""
    if pacer.items_waiting:
        tally.warn(
            f"the call ended with {pacer.items_waiting} pictures of its model not sent:"
            " it was too short for --startup-bitrate"
        )
