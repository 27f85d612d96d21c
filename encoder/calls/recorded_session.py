"""A recorded call: a part for each person who is followed, each with a model of its own.

first pass: landmarks of every frame; a switch to another face, or somebody else after a gap or a
cut, begins a part.  Between the passes each part has its model built; in the second pass its faces
are fitted.  Parts are coded one by one and sent one after the other: the face of the one before is
lost at its end and found again where the next one begins.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from math import ceil

import numpy as np

from encoder.calls.face_search import open_landmark_search
from encoder.calls.packet_sender import PacketSender
from encoder.calls.session_stats import SessionStats
from encoder.calls.two_pass_session import EncodedCall, TwoPassEncoder
from encoder.capture.frame_times import FrameTimes
from encoder.capture.video_source import Capture
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import ModelBudget
from encoder.coding.rate_control import packet_spans
from encoder.person.person_watch import PersonWatch, Verdict
from protocol.call_parameters import CallParameters
from protocol.limits import MAX_MODEL_VERSIONS, SEQUENCE_MODULUS
from shared_model.arrays import Array, Picture


class RecordedEncoder:
    """A `FramePass` over a source that can be read twice; see above.

    Call `frame` with every frame, `build_models`, `fit_frames` with every frame again, then
    `encode` at one bitrate or several.  Raises `UserError` as `open_landmark_search` does.
    """

    def __init__(self, capture: Capture, stats: SessionStats, gop: GopStructure) -> None:
        # Eyelids are fitted with the person's own appearance, in the second pass.
        self._search = open_landmark_search(stats, refine_eyelids=False)
        self._capture, self._stats, self._gop = capture, stats, gop
        self._watch = PersonWatch()
        self._undecided: list[tuple[int, Picture, Array | None]] = []
        self._parts = [self._new_part()]

    @property
    def started(self) -> bool:
        """Whether the first pass has found a face yet."""
        return self._parts[0].started or bool(self._undecided)

    @property
    def faces_fitted(self) -> int:
        """Number of faces that `fit_frames` has fitted."""
        return sum(part.faces_fitted for part in self._parts)

    def frame(self, index: int, picture: Picture, next_frame: Picture | None = None) -> None:
        """First pass over source frame `index`.  next_frame: see `LandmarkTracker.update`."""
        found = self._search.find(picture, next_frame)
        if found is None:
            self._watch.miss()
            self._keep(index, picture, None)
            return
        verdict = self._watch.judge(picture, found.points, self._search.is_cut)
        if self._search.has_switched:
            self._release()
            self._watch.begin()
            verdict = Verdict.OTHER
        if verdict is Verdict.OTHER and len(self._parts) < MAX_MODEL_VERSIONS:
            self._end_part()
        self._keep(index, picture, found.points)
        if verdict is not Verdict.UNDECIDED:
            self._release()

    def build_models(self, budget: ModelBudget) -> None:
        """Between the passes: identity and appearance of each person."""
        self._release()
        for part in self._parts:
            part.build_model(budget)

    def fit_frames(self, frames: Iterable[tuple[int, Picture]]) -> None:
        """Second pass over source frames (index, picture): fit the faces in those to be coded."""
        starts = [part.first_face for part in self._parts[1:]]

        def part_of(item: tuple[int, Picture]) -> int:
            return int(np.searchsorted(starts, item[0], "right"))

        for number, of_part in groupby(frames, part_of):
            self._parts[number].fit_frames(of_part)

    def encode(self, bitrate: float, progressive: bool = False) -> list[EncodedCall]:
        """The parts of the call at `bitrate` bits per second, all frame packets counted.

        progressive: the model of the first one is split into layers.
        """
        fitted = [part for part in self._parts if part.faces_fitted]
        calls = [part.encode(bitrate, progressive and not i) for i, part in enumerate(fitted)]
        return [
            replace(call, model=replace(call.model, version=number, version_count=len(calls)))
            for number, call in enumerate(calls)
        ]

    def may_have_residual(self, bitrate: float) -> bool:
        """Whether the call has bits, and pictures, for a picture residual."""
        return self._parts[0].may_have_residual(bitrate)

    def _new_part(self) -> TwoPassEncoder:
        return TwoPassEncoder(self._capture, self._stats, self._gop)

    def _end_part(self) -> None:
        """What waits, and what follows, is of another person."""
        if self._parts[-1].started:
            # Frames without a face still belong to the part before.
            while self._undecided and self._undecided[0][2] is None:
                self._give(*self._undecided.pop(0))
            self._parts.append(self._new_part())

    def _keep(self, index: int, picture: Picture, points: Array | None) -> None:
        self._undecided.append((index, picture, points))
        if points is None and all(waiting[2] is None for waiting in self._undecided):
            self._release()

    def _release(self) -> None:
        for waiting in self._undecided:
            self._give(*waiting)
        self._undecided = []

    def _give(self, index: int, picture: Picture, points: Array | None) -> None:
        if points is None:
            self._parts[-1].miss(index, picture)
        else:
            self._parts[-1].take(index, picture, points)


def send_call(
    parts: Sequence[EncodedCall],
    packets: PacketSender,
    pace: FrameTimes | None,
    stop: Callable[[], bool],
) -> None:
    """Send the parts of an encoded call.

    pace: no packet is sent before its last source frame is over; None: as fast as possible.
    stop: asked before each packet but the first; the call ends there.
    """
    begin, first, frames = time.monotonic(), 0, 0
    for number, part in enumerate(parts):
        if number:
            first = _change_person(parts[number - 1], first, part.model.call, packets)
        packets.send_model(replace(part.model, sequence=first % SEQUENCE_MODULUS))
        if part.layers is not None:
            packets.begin_layers(part.layers)
        frames = _send_part(part, first, begin, packets, pace, stop)
        if frames != part.frames:
            break
    else:
        _lose_face(part, packets)
    packets.warn_of_incomplete_model()
    packets.send_times(frames - 1)
    packets.end(frames)


def _send_part(
    part: EncodedCall,
    first: int,
    begin_s: float,
    packets: PacketSender,
    pace: FrameTimes | None,
    stop: Callable[[], bool],
) -> int:
    """Send the frame packets of a part; returns the frames of the call until its end, or its stop.

    first: number of its first packet.  begin_s: when the call began.
    """
    call = part.model.call
    start, step = call.start_frame, call.frame_step
    spans = packet_spans(len(range(start, part.frames, step)), call.frames_per_packet)
    for number, (payload, (place, end)) in enumerate(zip(part.payloads, spans, strict=False)):
        if number and stop():
            return start + place * step
        if pace is not None:
            due_s = begin_s + pace.time_s(start + (end - 1) * step + 1)
            time.sleep(max(0.0, due_s - time.monotonic()))
        packets.send_times(start + (end - 1) * step)
        shown = frozenset(start + i * step for i in range(place, end))
        packets.report_face(not shown <= part.lost, start + place * step)
        if shown <= part.empty:
            packets.report_absence(start + place * step)
        packets.send_frames(first + number, payload, (end - place) * step / call.fps)
    return part.frames


def _change_person(
    before: EncodedCall, first: int, following: CallParameters, packets: PacketSender
) -> int:
    """End a part of the call; returns the number of the packet with which the next one begins.

    first: number of the first packet of the part `before`.
    """
    call, start = before.model.call, following.start_frame
    _lose_face(before, packets)
    packets.report_face(False, before.last_face + 1)
    packets.send_times(start)
    packets.send_voice_alone(start - 1)
    packets.report_face(True, start)
    steps = call.frames_per_packet * call.frame_step
    return first + max(len(before.payloads), ceil((start - call.start_frame) / steps))


def _lose_face(part: EncodedCall, packets: PacketSender) -> None:
    """Say from which frame on a part has no face any more, if it has frames without."""
    after = [frame for frame in part.lost if frame > part.last_face]
    if not after:
        return
    packets.report_face(False, part.last_face + 1)
    gone = [frame for frame in part.empty if frame > part.last_face]
    if gone:
        packets.report_absence(min(gone))
