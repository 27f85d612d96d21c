"""The thesis profile, sending side: a first good frame is the model, then ten samples a second.

A better identity goes out as an update: a model packet with neither texture nor background, since
those before stay.
"""

from dataclasses import replace
from fractions import Fraction
from math import ceil

import numpy as np
from numpy.typing import NDArray

from encoder.calls.model_updates import AHEAD
from encoder.calls.session_stats import Tally
from encoder.calls.two_pass_session import send_part
from encoder.capture.video_source import Capture
from encoder.coding.model_packet import (
    Budget,
    build_model,
    call_parameters,
    reference_of,
    shape_packet,
)
from encoder.fitting.identity import Fitted
from encoder.tracking.trackers import Follower, blend
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ, encode_thesis
from protocol.link.interface import PacketSink
from protocol.packets import (
    SEQUENCE_MODULUS,
    ControlKind,
    ControlPacket,
    FramePacket,
    ModelPacket,
)
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters

Picture = NDArray[np.uint8]


class ThesisSender:
    """Sends the thesis profile: ten samples a second, each interpolated at its own time."""

    def __init__(self, sink: PacketSink, model: ModelPacket, tally: Tally) -> None:
        self._sink, self._tally = sink, tally
        self._model, call = model, model.call
        self._frames_per_sample = (
            Fraction(call.fps_numerator, call.fps_denominator) / THESIS_RATE_HZ
        )
        self._number = self._first = 0
        self._coming: tuple[int, ModelPacket] | None = None
        self._before: FaceParameters | None = None
        send_part(model, sink, tally)

    @property
    def model(self) -> ModelPacket:
        """The model packet that samples are of."""
        return self._model

    def announce(self, shape: ModelPacket) -> int:
        """Send an update of the shape: the source frame from which on faces must be of it."""
        number = self._number + AHEAD
        # No sample before it may be interpolated from the frame at which it begins.
        while self._place(number - 1) > (start := ceil(self._place(number))) - 1:
            number += 1
        layer = self._model.layer + 1
        update = replace(
            shape,
            call=replace(shape.call, start_frame=start),
            sequence=number % SEQUENCE_MODULUS,
            layer=layer,
            layers=layer + 1,
        )
        self._coming = number, update
        send_part(update, self._sink, self._tally)
        return start

    def _enter(self) -> None:
        """Take up an update whose first sample is due."""
        if self._coming is not None and self._number >= self._coming[0]:
            self._first, self._model = self._coming
            self._coming = None

    def send_face(self, index: int, face: FaceParameters) -> None:
        """Send the samples due up to source frame `index`, in which the caller is `face`."""
        before = self._before or face
        while (place := self._next_place()) <= index:
            share = 1.0 if place <= index - 1 else float(place - (index - 1))
            model = self._model
            payload = encode_thesis(
                blend(before, face, share), model.reference_pose, model.call.lids
            )
            self._tally.frame_bytes += len(payload)
            packet = FramePacket(self._number % SEQUENCE_MODULUS, payload)
            self._tally.send(self._sink, packet)
            self._number += 1
        self._before = face

    def send_control(self, kind: ControlKind, frame: int) -> None:
        """Say what happened at source frame `frame`; after LOST no samples are due until FOUND."""
        if kind is ControlKind.FOUND:
            self._before = None
            while self._place(self._number) < frame:
                self._number += 1
        self._tally.send(self._sink, ControlPacket(0, kind, frame))

    def _next_place(self) -> Fraction:
        self._enter()
        return self._place(self._number)

    def _place(self, number: int) -> Fraction:
        """The source frame of a sample under the model in use."""
        return self._model.call.start_frame + (number - self._first) * self._frames_per_sample


class ThesisCall:
    """The state of one call on the sending side.

    look_for_face_s: say so if there is no face after this many seconds of video.
    lids: send them as well.
    """

    def __init__(
        self,
        capture: Capture,
        follower: Follower,
        sink: PacketSink,
        budget: Budget,
        look_for_face_s: float,
        tally: Tally,
        lids: bool = False,
    ) -> None:
        self._capture, self._tally, self._budget = capture, tally, budget
        self._follower, self._sink = follower, sink
        self._look_for_face_s, self._lids = look_for_face_s, lids
        self._sender: ThesisSender | None = None
        self._better: tuple[int, Fitted] | None = None  # an identity, and the frame it begins with
        self._lost = False

    @property
    def started(self) -> bool:
        """Whether a face has been found yet."""
        return self._sender is not None

    def frame(self, index: int, frame: Picture, coming: Picture | None = None) -> None:
        """Find the face in source frame `index` and send what is due.

        coming: see `Follower.update`.
        """
        with self._tally.stage("follow" if self.started else "first face"):
            self._adopt(index)
            face = self._follower.update(frame, coming)
        if face is None:
            self._miss(index)
            return
        if self._sender is None:
            with self._tally.stage("model"):
                model = self._model(index, frame, face)
            self._sender = ThesisSender(self._sink, model, self._tally)
            face = reference_of(model)
        elif self._lost:
            self._sender.send_control(ControlKind.FOUND, index)
        self._lost = False
        self._sender.send_face(index, face)
        better = self._follower.improvement()
        if better is not None:
            call = replace(self._sender.model.call, focal_px=better.camera.focal_px)
            shape = shape_packet(better, better.frames[0], call)
            self._better = self._sender.announce(shape), better

    def end(self, frames: int) -> None:
        """Close a call of `frames` source frames."""
        if self._sender is not None:
            self._sender.send_control(ControlKind.END, frames)

    def _adopt(self, index: int) -> None:
        """Follow the caller under a better identity from the frame on that it begins with."""
        if self._better is not None and index >= self._better[0]:
            self._follower.adopt(self._better[1])
            self._better = None

    def _miss(self, index: int) -> None:
        self._tally.lost_frames += 1
        if self._sender is not None:
            if not self._lost:
                self._sender.send_control(ControlKind.LOST, index)
            self._lost = True
        elif index / self._capture.fps >= self._look_for_face_s:
            self._tally.warn(f"no face in the first {self._look_for_face_s:g} s; still looking")

    def _model(self, index: int, frame: Picture, face: FaceParameters) -> ModelPacket:
        fitted = self._follower.fitted
        call = call_parameters(self._capture, "thesis", fitted.camera.focal_px, index)
        call = replace(call, lids=self._lids)
        return build_model(generic_head(), fitted, face, frame, call, self._budget)
