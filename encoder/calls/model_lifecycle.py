"""The versions of a live call's model: when one is trained, announced and switched to.

The first faces make the first version: shape and mean texture, and modes of a face that has been
seen for a second before it is coded.  Between one model packet and the next, modes are learned and
sent one by one; at times the whole model is trained again and sent as an update.

`model_states` has the table of what follows what.  Another face (`encoder.live_model.other_face`)
is an update, too; the caller's wait until it goes.  So is the first version of somebody else who
sits down where the caller sat.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace

from encoder.calls.model_states import ModelEvent, ModelState, ModelStates
from encoder.calls.model_updates import ModelUpdateSender, StreamPosition
from encoder.calls.session_callbacks import CallEvents
from encoder.calls.session_stats import SessionStats
from encoder.learning.face_sample import FaceSample
from encoder.learning.incremental_modes import LearnedMode
from encoder.learning.mode_scheduler import FramePlace, ModeScheduler
from encoder.live_model.call_trainer import CallTrainers, FirstModel
from encoder.live_model.learner import Learner, ModesTask, TrainingTask
from encoder.live_model.model_schedule import ModelSchedule, TrainingFrames
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.other_face import FaceChoice
from shared_model.arrays import Array, Picture
from shared_model.parameters import FaceParameters

# An update that the link carries within this time goes before modes; on a thinner link it waits
# until no mode is learned: a few modes soon are better than all of the update late.
UPDATE_WAIT_LIMIT_S = 3.0


class ModelLifecycle:
    """Trains, announces and switches the versions of one call's model.

    fps: of the source.
    trainers: of the first versions; their pacing is that of all.
    learner: trains updates and learns modes.
    shown: whose face is shown.  clock: seconds from any origin.
    early: the first version, if it was made before there was a frame to send.
    """

    def __init__(
        self,
        fps: float,
        trainers: CallTrainers,
        updates: ModelUpdateSender,
        stats: SessionStats,
        learner: Learner,
        shown: FaceChoice,
        events: CallEvents,
        clock: Callable[[], float],
        early: FirstModel | None = None,
    ) -> None:
        self._fps, self._trainers, self._early = fps, trainers, early
        self._updates, self._stats, self._shown = updates, stats, shown
        pacing = trainers.pacing
        self._learner, self._pacing, self._events = learner, pacing, events
        self._frames = TrainingFrames(pacing.training_frames)
        self._faces = 0  # source frames of the person's face
        self._schedule = ModelSchedule(fps, pacing.updates)
        self._modes = ModeScheduler(
            fps,
            pacing.mode_interval_s,
            pacing.mode_samples_per_s,
            self._learn,
            clock,
            one_by_one=pacing.in_real_time,
            bytes_per_s=trainers.mode_limits.bytes_per_s,
        )
        self._states = ModelStates(events.on_state)
        self._training: Future[ModelVersion] | None = None
        self._version: ModelVersion | None = None
        self._next_version: ModelVersion | None = None
        # Somebody else is in the picture: their first version is to be trained, or is announced.
        self._awaits_newcomer = self._is_newcomer_announced = False

    @property
    def state(self) -> ModelState:
        """See `model_states`."""
        return self._states.state

    @property
    def version(self) -> ModelVersion:
        """The version that codes frames now.  Raises `ValueError` before there is one."""
        if self._version is None:
            raise ValueError("no face has been found, expected start before version")
        return self._version

    @property
    def coding_version(self) -> ModelVersion:
        """The version that frames are coded with: the caller's, or that of another face."""
        return self._shown.coding_version or self.version

    def to_code(
        self, faces: Sequence[FaceParameters]
    ) -> tuple[ModelVersion, Sequence[FaceParameters]]:
        """What is coded of the caller's faces, and with which version."""
        return self.coding_version, self._shown.faces(faces, self.version)

    @property
    def is_changing_person(self) -> bool:
        """Whether the version in use is not of the person who is in the picture."""
        return self._awaits_newcomer or self._is_newcomer_announced

    def change_person(self) -> None:
        """From the next frame on somebody else is in the picture."""
        self._frames.forget()
        self._faces = 0
        self._schedule = ModelSchedule(self._fps, self._pacing.updates)
        self._awaits_newcomer = True

    def add_frame(self, picture: Picture, points: Array, frames: int) -> None:
        """Take a frame (h, w, 3) BGR with its landmarks (468, 3), pixels, to train from.

        frames: that it counts for: those before it that were not looked at, and itself.
        """
        self._frames.offer(picture, points)
        self._faces += frames

    def start(self, index: int) -> None:
        """Send the first version, trained from the frames so far if there is none yet; used from
        `index` on.
        """
        first = self._early or self._train_first()
        trainer, version = first.trainer, first.version.placed_at(0, index)
        self._early, self._version = None, version
        self._updates.send_first(self._shown.begin(version, index))
        self._learner.begin(trainer)
        self._start_modes(version)
        self._states.on(ModelEvent.FIRST_SENT)

    def _train_first(self) -> FirstModel:
        # In real time, and on a thin link, an update brings what takes long.
        is_hurried = self._pacing.in_real_time or self._updates.progressive
        share = self._schedule.first_share(0 if is_hurried else self._faces)
        return self._trainers.first_model(*self._frames.sample(), self._updates.progressive, share)

    def learn_modes(
        self,
        index: int,
        sample: Callable[[], FaceSample] | None,
        may_start: bool,
        place: FramePlace | None = None,
    ) -> bool:
        """Learn modes from source frame `index`, and send those that are learned.

        sample: makes the frame's, with the face as the version in use has it, or without one; None:
            the frame is not one to learn from.
        may_start: begin to learn now if it is time.
        place: see `ModeScheduler.wants_sample`.
        Returns whether the version in use has modes that it had not.
        """
        if self._shown.is_hidden or self.is_changing_person:
            return False
        for_next = self._states.state is ModelState.SWITCHING
        if sample is not None and self._modes.wants_sample(index, place):
            made = sample()
            self._modes.add_sample(index, replace(made, face=None) if for_next else made)
        if not self._may_send_modes:
            return False
        version = self._next_version if for_next else self._version
        assert version is not None
        most = max(version.free_slots - self._modes_to_reserve, 0)
        with self._stats.stage("modes"):
            modes = self._modes.take_modes(index, most, may_start)
        for mode in modes:
            version = version.with_mode(mode)
            self._updates.send_mode(version, mode.data)
            self._events.on_mode(version, mode.data)
        if for_next:
            self._next_version = version
            return False
        self._version = version
        return bool(modes)

    def train_if_due(self, position: StreamPosition) -> None:
        """Begin to train an update when one is due; announce one that is trained."""
        if self._updates.busy:
            return
        if self._shown.is_wanted:
            self._show_other(position)
            return
        if self._awaits_newcomer:
            self._follow_person(position)
            return
        is_back = self._shown.coding_version is not None
        is_due = is_back or self._schedule.is_update_due(self._faces)
        if is_due and self._states.may(ModelEvent.UPDATE_DUE):
            self._training = self._train_update()
            self._states.on(ModelEvent.UPDATE_DUE)
        if self._training is not None and self._training.done():
            update, self._training = self._training.result(), None
            self._send_update(self._shown.with_background(update), position)

    def _follow_person(self, position: StreamPosition) -> None:
        """Announce the first version of somebody else, instead of an update of the one before."""
        if self._states.may(ModelEvent.UPDATE_DUE):
            self._states.on(ModelEvent.UPDATE_DUE)
        if self._states.state is not ModelState.TRAINING:
            return
        self._training, self._awaits_newcomer = None, False
        pictures, points = self._frames.sample()
        with self._stats.stage("train"):
            trainer = self._trainers.trainer(
                pictures[0], points[0], self._updates.progressive, self._shown.next_number
            )
            version = trainer.follow(pictures, points)
        self._learner.begin(trainer)
        self._is_newcomer_announced = True
        self._send_update(version, position)

    def _show_other(self, position: StreamPosition) -> None:
        """Announce the other face, instead of an update that is being trained."""
        if self._shown.coding_version is None and self._states.may(ModelEvent.UPDATE_DUE):
            self._states.on(ModelEvent.UPDATE_DUE)
        if self._states.state is ModelState.TRAINING:
            self._training = None
            self._send_update(self._shown.next_other(), position)

    def _send_update(self, update: ModelVersion, position: StreamPosition) -> None:
        self._next_version = self._updates.start_update(update, position)
        self._shown.note_sent(update)
        announced = self._next_version is not None
        self._states.on(ModelEvent.ANNOUNCED if announced else ModelEvent.LAYERS_BEGUN)

    def on_packet_sent(self, position: StreamPosition) -> bool:
        """Switch to the next version if its first packet is next; whether it is."""
        switched = self._switch_if_due(position.packet)
        if self._states.state is ModelState.SENDING_LAYERS:
            self._next_version = self._updates.take_announced(position)
            if self._next_version is not None:
                self._states.on(ModelEvent.ANNOUNCED)
        return switched

    def switches_at(self, packet: int) -> bool:
        """Whether frame packet `packet` is the first of another version."""
        return self._next_version is not None and packet == self._next_version.first_packet

    def end(self) -> None:
        """End the call: no version follows."""
        if self._version is not None:
            self._updates.warn_of_incomplete_model(self._version)
        self._states.on(ModelEvent.CALL_ENDED)

    def _switch_if_due(self, packet: int) -> bool:
        following = self._next_version
        if following is None:
            return False
        # In layers the modes of the update itself are still to come.
        lead = 0 if self._updates.progressive else self._pacing.mode_lead_packets
        is_near = packet >= following.first_packet - lead
        if is_near and self._states.may(ModelEvent.SWITCH_NEAR):
            if not self._shown.is_other(following):
                self._start_modes(following)
            self._states.on(ModelEvent.SWITCH_NEAR)
        if not self.switches_at(packet):
            return False
        self._version, self._next_version = self._shown.switch(self._version, following), None
        self._is_newcomer_announced = False
        self._states.on(ModelEvent.SWITCHED)
        return True

    def _train_update(self) -> "Future[ModelVersion]":
        share = self._schedule.take_update()
        # While layers were sent more than one may have become due.
        while self._updates.progressive and self._schedule.is_update_due(self._faces):
            share = self._schedule.take_update()
        task = TrainingTask(share, *self._frames.sample(), self._shown.next_number)
        with self._stats.stage("train"):
            return self._learner.train(task)

    def _start_modes(self, version: ModelVersion) -> None:
        samples_per_s = self._pacing.mode_samples_per_s
        self._learner.start_modes(version, samples_per_s, self._trainers.mode_limits)
        self._modes.start()

    def _learn(
        self, samples: Sequence[FaceSample], byte_budget: float, max_modes: int
    ) -> "Future[list[LearnedMode]]":
        return self._learner.learn(ModesTask(samples, byte_budget, max_modes))

    @property
    def _may_send_modes(self) -> bool:
        """Whether the link is for modes now."""
        # In layers what is sent is of the update, once there is one.
        is_of_update = self._updates.progressive and self._next_version is not None
        if self._updates.busy or is_of_update:
            return False
        if not self._is_update_waiting:
            return True
        return self._updates.transmission_time_s(self._trainers.budget) >= UPDATE_WAIT_LIMIT_S

    @property
    def _is_update_waiting(self) -> bool:
        if self._training is not None:
            return self._training.done()
        is_due = self._schedule.is_update_due(self._faces)
        return self._updates.progressive and is_due

    @property
    def _modes_to_reserve(self) -> int:
        """How many free slots to leave for later frames."""
        if self._states.state in (ModelState.TRAINING, ModelState.ANNOUNCED):
            # The version in use is about to be replaced.
            return 0
        return self._schedule.modes_to_reserve(self._faces)
