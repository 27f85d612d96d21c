"""The default profile of a recorded source, sending side: survey, learn, refine, code, send."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.capture import Capture
from encoder.crop import crop_face
from encoder.detect import BlazeFaceDetector
from encoder.landmarks import LandmarkTracker
from encoder.model import Budget, call_parameters
from encoder.networks import NetworkFilesMissing, find_network_folder
from encoder.rate import Spending, code_call, packet_spans
from encoder.tally import Tally
from encoder.texture import code_background
from encoder.two_pass import (
    Learned,
    Sampler,
    combine_call,
    default_model,
    follow_all,
    learn_caller,
    smoothed,
)
from protocol.link import PacketSink
from protocol.messages import (
    SEQUENCE_MODULUS,
    ControlKind,
    ControlPacket,
    FramePacket,
    ModelPacket,
    serialise,
)
from shared_model.errors import UserError
from shared_model.parameters import FaceParameters
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

FRAMES_PER_PACKET = 8


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

    def __init__(self, capture: Capture, tally: Tally) -> None:
        try:
            folder = find_network_folder()
        except NetworkFilesMissing as error:
            raise UserError(f"{error}; without them use --profile thesis") from error
        self._tracker = LandmarkTracker(folder, BlazeFaceDetector(folder))
        self._capture, self._tally = capture, tally
        self._points: list[Array] = []
        self._number: dict[int, int] = {}  # source frame -> place among those with a face
        self._frames = 0
        self._sampler = Sampler()
        self._still: Picture | None = None
        self._learned: Learned | None = None
        self._start: list[FaceParameters] = []
        self._faces: list[FaceParameters] = []

    @property
    def faces_seen(self) -> int:
        """Number of frames with a face so far."""
        return len(self._points)

    @property
    def faces_refined(self) -> int:
        """Number of them that `refine` has been over."""
        return len(self._faces)

    def frame(self, index: int, frame: Picture) -> None:
        """First pass over source frame `index`: where are the landmarks."""
        with self._tally.stage("landmarks"):
            found = self._tracker.update(frame)
        self._frames = index + 1
        if self._tracker.faces_seen > 1:
            self._tally.warn(f"{self._tracker.faces_seen} faces in the picture: taking the largest")
        if found is None:
            self._tally.lost_frames += 1
            return
        if self._still is None:
            self._still = frame
        self._number[index] = len(self._points)
        self._sampler.offer(len(self._points), lambda: frame)
        self._points.append(found.points)

    def learn(self, budget: Budget) -> None:
        """Between the passes: identity, appearance model."""
        head = surrounded_head()
        size = (self._capture.width, self._capture.height)
        with self._tally.stage("fit"):
            fitted, self._start = follow_all(head, size, list(smoothed(np.array(self._points))))
        focal_px, start = fitted.camera.focal_px, min(self._number)
        call = call_parameters(self._capture, "default", focal_px, start, FRAMES_PER_PACKET)
        with self._tally.stage("learn"):
            self._learned = learn_caller(
                head, fitted, self._start, self._sampler.frames, self._points, call, budget
            )
        self._call, self._budget = call, budget

    def refine(self, index: int, frame: Picture) -> None:
        """Second pass over source frame `index`: analysis by synthesis."""
        number = self._number.get(index)
        if number is None or self._learned is None:
            return
        caller = self._learned.caller
        with self._tally.stage("refine"):
            crop = crop_face(frame, self._points[number], caller.pixels_per_texel)
            self._faces.append(caller.tracker.refine(crop, self._start[number], 3))

    def code(self, bitrate: float) -> CodedCall:
        """The call at `bitrate` bits per second, all frame packets counted."""
        assert self._learned is not None and self._still is not None
        last = max(i for i, number in self._number.items() if number < len(self._faces))
        frames = self._frames if len(self._faces) == len(self._number) else last + 1
        held = held_numbers(self._number, self._call.start_frame, last + 1)
        with self._tally.stage("combine"):
            components, values = combine_call(self._learned, self._faces, FRAMES_PER_PACKET)
            background = code_background(self._still, self._budget.background_bytes)
            model = default_model(self._learned.caller, components, self._call, background)
        spending = Spending(bitrate, float(self._capture.fps), FRAMES_PER_PACKET)
        with self._tally.stage("code"):
            packets = code_call(values[held], components.spreads, spending)
        lost = frozenset(set(range(self._call.start_frame, frames)) - set(self._number))
        return CodedCall(model, tuple(p.payload for p in packets), frames, lost)


def held_numbers(number: dict[int, int], start: int, end: int) -> list[int]:
    """For each source frame from `start` to `end`, the newest of the found faces until then."""
    held, last = [], number[start]
    for index in range(start, end):
        last = number.get(index, last)
        held.append(last)
    return held


def send_call(
    call: CodedCall, sink: PacketSink, tally: Tally, fps: float | None, stop: Callable[[], bool]
) -> None:
    """Send a coded call, as fast as it goes or at `fps` source frames per second."""
    tally.model_bytes += len(serialise(call.model)) - 1
    tally.send(sink, call.model)
    begin, start = time.monotonic(), call.model.call.start_frame
    spans = packet_spans(call.frames - start, FRAMES_PER_PACKET)
    lost = False
    for number, (payload, (first, end)) in enumerate(zip(call.payloads, spans, strict=False)):
        if stop():
            break
        if fps is not None:
            time.sleep(max(0.0, begin + (start + end) / fps - time.monotonic()))
        gone = all(start + i in call.lost for i in range(first, end))
        if gone != lost:
            kind = ControlKind.LOST if gone else ControlKind.FOUND
            tally.send(sink, ControlPacket(0, kind, start + first))
            lost = gone
        tally.frame_bytes += len(payload)
        tally.send(sink, FramePacket(number % SEQUENCE_MODULUS, payload))
    tally.send(sink, ControlPacket(0, ControlKind.END, call.frames))
