"""The thesis profile, sending side: the first frame with a face makes the model, then ten samples
a second are sent.

An improved identity is sent as an update: a model packet without texture and background; the
decoder keeps those it has.
"""

from dataclasses import replace
from fractions import Fraction
from math import ceil

from encoder.calls.face_search import warn_of_long_search
from encoder.calls.packet_sender import LEAD_PACKETS, PacketSender
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import Capture
from encoder.coding.model_packet import (
    ModelBudget,
    build_thesis_model_packet,
    call_parameters,
    geometry_packet,
)
from encoder.fitting.fit_results import IdentityFit
from encoder.thesis.trackers import FaceTracker
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ, encode_thesis
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from shared_model.arrays import Picture
from shared_model.geometry import interpolate
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters

SAMPLE_S = 1 / THESIS_RATE_HZ


class FixedRateSender:
    """Sends ten samples a second, each interpolated between the two frames around its time."""

    def __init__(self, packets: PacketSender, model: ModelPacket) -> None:
        self._packets, self._model, call = packets, model, model.call
        self._frames_per_sample = (
            Fraction(call.fps_numerator, call.fps_denominator) / THESIS_RATE_HZ
        )
        # Of the next sample, and of the first one under the model in use.
        self._number = self._first = 0
        self._update: tuple[int, ModelPacket] | None = None  # and the number of its first sample
        self._previous: FaceParameters | None = None
        packets.send_model(model)

    @property
    def model(self) -> ModelPacket:
        """The model packet in use."""
        return self._model

    def announce_update(self, shape: ModelPacket) -> int:
        """Send an update of the shape; returns the source frame from which on it is used."""
        number = self._number + LEAD_PACKETS
        # No sample before it may be interpolated from the frame at which it begins.
        while self._sample_time(number - 1) > (start := ceil(self._sample_time(number))) - 1:
            number += 1
        version = self._model.version + 1
        update = replace(
            shape,
            call=replace(shape.call, start_frame=start),
            sequence=number % SEQUENCE_MODULUS,
            version=version,
            version_count=version + 1,
        )
        self._update = number, update
        self._packets.send_model(update)
        return start

    def send_face(self, index: int, face: FaceParameters) -> None:
        """Send the samples due up to source frame `index`, which shows `face`."""
        if self._packets.report_face(True, index):
            self._resume_at(index)
        previous = self._previous or face
        while (due := self._next_sample_time()) <= index:
            share = 1.0 if due <= index - 1 else float(due - (index - 1))
            model = self._model
            sample = interpolate(previous, face, share)
            payload = encode_thesis(sample, model.reference_pose, model.call.has_eyelids)
            self._packets.send_frames(self._number, payload, SAMPLE_S)
            self._number += 1
        self._previous = face

    def report_lost(self, index: int) -> None:
        """Source frame `index` shows no face; no samples are due until the next one with a face."""
        self._packets.report_face(False, index)
        self._packets.send_voice_alone(index)

    def _resume_at(self, frame: int) -> None:
        self._previous = None
        while self._sample_time(self._number) < frame:
            self._number += 1

    def _next_sample_time(self) -> Fraction:
        if self._update is not None and self._number >= self._update[0]:
            self._first, self._model = self._update
            self._update = None
        return self._sample_time(self._number)

    def _sample_time(self, number: int) -> Fraction:
        """Time of a sample under the model in use, in source frames."""
        return self._model.call.start_frame + (number - self._first) * self._frames_per_sample


class ThesisEncoder:
    """A `CallSession` in the thesis profile.

    look_for_face_s: add a warning if there is no face after this many seconds of video.
    lids: send the eyelids, too.
    """

    def __init__(
        self,
        capture: Capture,
        tracker: FaceTracker,
        packets: PacketSender,
        budget: ModelBudget,
        look_for_face_s: float,
        stats: SessionStats,
        lids: bool = False,
    ) -> None:
        self._capture, self._stats, self._budget = capture, stats, budget
        self._tracker, self._packets = tracker, packets
        self._look_for_face_s, self._lids = look_for_face_s, lids
        self._sender: FixedRateSender | None = None
        # An improved identity, and the source frame from which on it is used.
        self._pending_identity: tuple[int, IdentityFit] | None = None

    @property
    def started(self) -> bool:
        """See `CallSession`."""
        return self._sender is not None

    def frame(self, index: int, picture: Picture, next_frame: Picture | None = None) -> None:
        """See `CallSession`."""
        with self._stats.stage("track" if self.started else "initialise"):
            self._adopt_identity(index)
            face = self._tracker.update(picture, next_frame)
        if face is None:
            self._miss(index)
            return
        if self._sender is None:
            with self._stats.stage("model"):
                model = self._build_model(index, picture, face)
            self._sender = FixedRateSender(self._packets, model)
            face = model.reference_face
        self._sender.send_face(index, face)
        self._send_improved_identity(self._sender)

    def end(self, frames: int) -> None:
        """See `CallSession`."""
        if self._sender is not None:
            self._packets.end(frames)

    def _miss(self, index: int) -> None:
        self._stats.lost_frames += 1
        if self._sender is not None:
            self._sender.report_lost(index)
        else:
            seconds = float(index / self._capture.fps)
            warn_of_long_search(seconds, self._look_for_face_s, self._stats)

    def _build_model(self, index: int, picture: Picture, face: FaceParameters) -> ModelPacket:
        identity = self._tracker.fitted
        call = call_parameters(self._capture.format, "thesis", identity.camera.focal_px, index)
        call = replace(call, has_eyelids=self._lids)
        return build_thesis_model_packet(
            generic_head(), identity, face, picture, call, self._budget
        )

    def _send_improved_identity(self, sender: FixedRateSender) -> None:
        improved = self._tracker.take_refined_identity()
        if improved is not None:
            call = replace(sender.model.call, focal_px=improved.camera.focal_px)
            shape = geometry_packet(improved, improved.frames[0], call)
            self._pending_identity = sender.announce_update(shape), improved

    def _adopt_identity(self, index: int) -> None:
        """Let the tracker use the improved identity from its first frame on."""
        if self._pending_identity is not None and index >= self._pending_identity[0]:
            self._tracker.adopt(self._pending_identity[1])
            self._pending_identity = None
