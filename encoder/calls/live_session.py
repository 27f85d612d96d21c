"""The default profile of a live source, sending side: every frame is coded and sent as it comes.

frame -> landmarks -> (delay) -> fit -> packet filled -> packet coded -> sent.  What happens to the
model meanwhile stands in `model_lifecycle`.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from encoder.calls.face_search import CallerSearch, warn_of_long_search
from encoder.calls.frame_packets import PacketCoder, PacketFiller
from encoder.calls.model_lifecycle import ModelLifecycle
from encoder.calls.model_states import ModelState
from encoder.calls.model_updates import ModelUpdateSender, StreamPosition
from encoder.calls.overload import OverloadController, overload_warning
from encoder.calls.packet_sender import PacketSender
from encoder.calls.session_callbacks import CallEvents
from encoder.calls.session_stats import SessionStats
from encoder.calls.waiting_frames import (
    Between,
    FrameBetween,
    FrameDelay,
    SeenFrame,
    may_lack_landmarks,
)
from encoder.capture.video_source import Capture
from encoder.coding.gop import GopStructure
from encoder.coding.rate_control import OnlineRateController, RateTarget
from encoder.learning.absence import AbsenceWatch
from encoder.learning.face_sample import FaceSample
from encoder.learning.mode_scheduler import FramePlace
from encoder.live_model.call_trainer import CallTrainers, FirstModel
from encoder.live_model.learner import Learner
from encoder.live_model.other_face import FaceChoice
from encoder.live_model.work_level import WorkLevel
from protocol.picture_residual.framing import covered_frames
from shared_model.arrays import Array, Picture
from shared_model.geometry import interpolate
from shared_model.parameters import FaceParameters


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """What the user wants of a live call.

    bitrate: bits per second of the frame packets.
    look_for_face_s: add a warning if there is no face after this many seconds of video.
    """

    bitrate: float
    gop: GopStructure
    look_for_face_s: float


class LiveEncoder:
    """A `CallSession` in the default profile that looks at no frame before it comes.

    trainers: of its models; their pacing says what the call may wait for.
    learner: trains and learns; one that is done at once gives the same bytes for the same source.
    shown: whose face is shown; None: the caller's.
    early: the first version of the model, if it was made before the call.
    clock: seconds from any origin.
    """

    def __init__(
        self,
        capture: Capture,
        packets: PacketSender,
        stats: SessionStats,
        settings: LiveSettings,
        trainers: CallTrainers,
        learner: Learner,
        shown: FaceChoice | None = None,
        events: CallEvents | None = None,
        early: FirstModel | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        gop, events = settings.gop, events or CallEvents()
        fps, coded_fps = float(capture.fps), float(gop.coded_fps(capture.fps))
        self._packets, self._stats, self._gop, self._fps = packets, stats, gop, fps
        self._look_for_face_s, self._clock = settings.look_for_face_s, clock
        pacing = trainers.pacing
        self._learner, self._pacing = learner, pacing
        self._overload = OverloadController(pacing.frame_limit_s(fps), pacing.max_lag_s)
        self._alternates_landmarks = pacing.alternates_landmarks(coded_fps)
        self._frame_begin_s, self._seen_index = 0.0, 0
        self._delay = FrameDelay(pacing.delay_s, fps)
        self._first_index = 0  # of the call's source frames
        updates = ModelUpdateSender(packets, stats, gop, fps, pacing.lead_packets)
        self._search, self._absence = CallerSearch(stats), AbsenceWatch()
        shown = shown or FaceChoice()
        self._model = ModelLifecycle(
            fps, trainers, updates, stats, learner, shown, events, clock, early
        )
        self._between, self._filler = FrameBetween(), PacketFiller(gop.frame_step)
        self._coded_fps, self._first_frame_s = coded_fps, 0.0
        target = RateTarget(settings.bitrate, coded_fps, gop.frames_per_packet)
        self._rate = OnlineRateController(target)
        self._coder = PacketCoder(self._rate, events.on_packet)

    @property
    def started(self) -> bool:
        """See `CallSession`."""
        return self._has_model or self._delay.shows_face

    @property
    def _has_model(self) -> bool:
        return self._model.state is not ModelState.SEARCHING

    def frame(self, index: int, picture: Picture, next_frame: Picture | None = None) -> None:
        """See `CallSession`."""
        self._packets.send_waiting()
        had_model, level = self._has_model, self._overload.level
        self._frame_begin_s = self._clock()
        is_between = bool(picture.size) and self._is_between(index, level)
        is_omitted = is_between and level.halves_frames
        if not is_between:
            self._see(index, picture, next_frame)
        elif not is_omitted:
            self._delay.add(SeenFrame(index, picture, None, self._frame_begin_s, is_between=True))
        for frame in self._delay.due(index):
            self._encode(frame)
        passed_s = self._clock() - self._frame_begin_s
        if not had_model:
            self._first_frame_s = passed_s
            return
        lag_s = self._overload.record_frame_time(passed_s)
        self._stats.note_frame(passed_s, lag_s, level, is_omitted)

    def end(self, frames: int) -> None:
        """See `CallSession`."""
        # In a hurry, nothing more would be learned in real time.
        for frame in self._delay.rest(self._pacing.clock_to_wait_by(self._clock)):
            self._frame_begin_s = self._clock()
            self._encode(frame)
        self._add_between(self._between.take_last())
        while len(self._filler):
            # By its last packet the call may reach a version whose modes are learned.
            self._send_packet()
        self.close()
        if not self._has_model:
            return
        self._model.end()
        if haste := overload_warning(self._stats.level_frames, self._stats.worst_lag_s):
            self._stats.warn(haste)
        if excess := self._rate.overshoot_message:
            self._stats.warn(excess)
        self._packets.end(frames)

    def close(self) -> None:
        """Leave what is being learned; for a call that ends by an error."""
        self._learner.close()

    def _see(self, index: int, picture: Picture, next_frame: Picture | None) -> None:
        """Find the face in a frame, to learn from it before it is coded."""
        frames, self._seen_index = max(1, index - self._seen_index), index
        points, is_other = self._search.find(picture, next_frame)
        self._delay.add(SeenFrame(index, picture, points, self._frame_begin_s, is_other))
        if points is None:
            return
        if is_other and self._has_model:
            self._model.change_person()
        self._model.add_frame(picture, points, frames)
        if self._pacing.learns_ahead:
            # Updates are trained, and modes learned, while their frames wait.
            self._begin(index)
            self._model.train_if_due(self._position)
            self._learn(index, lambda: self._model.version.mode_sample(picture, points))

    def _learn(
        self,
        index: int,
        sample: Callable[[], FaceSample] | None = None,
        may_start: bool = True,
        place: FramePlace | None = None,
    ) -> None:
        """Learn modes from source frame `index`, and use those that are learned.

        sample, may_start, place: see `ModelLifecycle.learn_modes`.
        """
        if self._model.learn_modes(index, sample, may_start, place):
            self._filler.mark_outdated()

    def _encode(self, frame: SeenFrame) -> None:
        index, picture = frame.index, frame.picture
        if frame.is_between:
            if self._is_coded(index):
                self._between.wait(index, picture)
            if self._has_model and not self._pacing.learns_ahead:
                self._learn(index)
            self._refit_waiting()
            return
        if not self._is_before_call(index):
            self._repeat_over_gap(index)
            self._packets.report_camera(bool(picture.size), index)
        if not picture.size:
            self._rest(index)
            return
        if frame.points is None:
            self._skip(index)
            self._look_for_person(index, picture)
            return
        self._begin(index)
        if self._model.is_changing_person:
            # The version in use would put on the face of the one before.
            self._skip(index)
        else:
            self._packets.add_source(index, picture)
            if self._is_coded(index):
                self._add(index, picture, frame.points)
        self._model.train_if_due(self._position)

    def _begin(self, index: int) -> None:
        """Send the first version of the model, if source frame `index` has the first face."""
        if not self._has_model:
            self._model.start(index)
            self._filler.start_at(index)
            self._first_index = index

    def _is_before_call(self, index: int) -> bool:
        return not self._has_model or index < self._first_index

    def _repeat_over_gap(self, index: int) -> None:
        """Fill and send the packets that end before source frame `index`.

        A camera leaves frames out if nobody takes them; these repeat the newest face.
        """
        step = self._gop.frame_step
        while self._filler.next_index + step * (self._most_frames - len(self._filler)) <= index:
            self._filler.fill_gap(index, self._most_frames)
            self._send_packet()

    def _rest(self, index: int) -> None:
        """The camera is off in source frame `index`."""
        if self._is_before_call(index):
            return
        version = self._model.version
        self._filler.fill_gap(index, self._most_frames - 1)
        if self._filler.is_coded(index):
            self._filler.add_rest(version.rest())
            self._send_full_packet()

    def _skip(self, index: int) -> None:
        """Source frame `index` shows no face."""
        if self._is_before_call(index):
            warn_of_long_search(index / self._fps, self._look_for_face_s, self._stats)
            return
        self._filler.fill_gap(index, self._most_frames - 1)
        self._filler.add_without_face(index)
        self._send_full_packet()

    def _look_for_person(self, index: int, picture: Picture) -> None:
        """Say if nobody is there in source frame `index`, which shows no face."""
        if self._is_before_call(index) or not self._packets.face_is_lost:
            return
        self._absence.take(index, picture)
        if index in self._absence.empty:
            self._packets.report_absence(index)

    def _add(self, index: int, picture: Picture, points: Array) -> None:
        """Fit the face in source frame `index` and add it to the packet."""
        version, level = self._model.version, self._overload.level
        fits_layers = self._pacing.fits_layers(len(self._filler))
        sample = version.sample(picture, points, fits_layers, level)
        with self._stats.stage("fit"):
            face = version.fit(sample, self._filler.initial_face, level)
        self._add_between(self._between.take(index, points), face)
        self._filler.fill_gap(index, self._most_frames - 1, face)
        self._filler.add(face, sample)
        if not self._pacing.learns_ahead:
            # All frames of a packet have the modes that are there when it goes out.
            may_start = self._pacing.may_start_learning(self._is_packet_full)
            # A mode of half the resolution would blur the face.
            crop = None if level.halves_resolution else sample.crop
            self._learn(
                index,
                lambda: version.mode_sample(picture, points, face, crop),
                may_start,
                self._place(index) if self._pacing.in_real_time else None,
            )
        self._refit_waiting()
        self._send_full_packet()

    def _add_between(self, between: Between | None, after: FaceParameters | None = None) -> None:
        """Fit and add the face in a frame, if there is one; `after`: in the frame after it."""
        before = self._filler.initial_face
        if between is None or before is None or not self._filler.is_coded(between.index):
            return
        version = self._model.version
        self._packets.add_source(between.index, between.picture)
        sample = version.sample(between.picture, between.points, with_layers=False)
        with self._stats.stage("fit"):
            face = before if after is None else interpolate(before, after, between.share)
            start = replace(face, layers=before.layers)
            self._filler.add(version.refit(sample, start), sample)

    def _refit_waiting(self) -> None:
        """Fit frames that wait again with the newest modes, as long as there is time."""
        version = self._model.version
        refit = self._pacing.refit(version.refit, version.refit_modes)
        with self._stats.stage("fit"):
            while self._may_refit and self._filler.refit_newest(refit):
                pass

    def _send_full_packet(self) -> None:
        if self._is_packet_full:
            self._send_packet()

    def _send_packet(self) -> None:
        """Code and send the frames that wait, then switch to the next version if it is time."""
        number, count = self._coder.number, self._position.packet_frames(self._gop)
        filled = self._filler.take(count)
        self._packets.report_face(filled.visible, filled.start_frame)
        with self._stats.stage("code"):
            version, faces = self._model.to_code(filled.faces)
            payload = self._coder.code(version, faces)
        duration_s = len(filled.faces) * self._gop.frame_step / self._fps
        own_number = number - version.first_packet
        covered = covered_frames(version.packet.call, own_number, len(filled.faces))
        has_time = self._overload.level is WorkLevel.FULL
        self._packets.send_frames(number, payload, duration_s, covered, has_time)
        if self._model.on_packet_sent(self._position):
            self._filler.reset_coefficients(self._model.version.rest())

    def _is_between(self, index: int, level: WorkLevel) -> bool:
        """Whether landmarks are not looked for in source frame `index`, but in the one before."""
        if not self._has_model or index - self._seen_index > self._gop.frame_step:
            return False
        is_halved = self._alternates_landmarks or level.halves_frames
        return is_halved and may_lack_landmarks(self._position.frames_to_last(index, self._gop))

    def _is_coded(self, index: int) -> bool:
        ahead = index - self._filler.next_index
        return ahead >= 0 and ahead % self._gop.frame_step == 0

    @property
    def _most_frames(self) -> int:
        """How many frames wait when the packet is coded: its own, and those that it waits for."""
        position = self._position
        own = position.packet_frames(self._gop)
        has_next = not (position.is_first or self._model.switches_at(position.packet + 1))
        return own + (self._held_frames(position) if has_next else 0)

    def _held_frames(self, position: StreamPosition) -> int:
        """How many frames a packet is coded after its last one."""
        age_s = (position.frame - self._first_index) / self._fps
        return int(self._pacing.packet_delay_s(age_s, self._first_frame_s) * self._coded_fps)

    def _place(self, index: int) -> FramePlace:
        """Where the newest frame, source frame `index`, is in its packet."""
        step, position = self._gop.frame_step, self._position
        to_last = position.frames_to_last(index, self._gop)
        return FramePlace(to_last * step, (to_last + self._held_frames(position)) * step)

    @property
    def _is_packet_full(self) -> bool:
        """Whether the packet is to be coded now."""
        return len(self._filler) >= self._most_frames

    @property
    def _position(self) -> StreamPosition:
        packet = self._coder.number
        is_first = packet == self._model.coding_version.first_packet
        return StreamPosition(packet, self._filler.start_frame, is_first)

    @property
    def _may_refit(self) -> bool:
        """Whether there is time to fit a waiting frame again."""
        passed_s = self._clock() - self._frame_begin_s
        return self._overload.may_refit(passed_s, self._is_packet_full)
