"""The default profile of a live source, sending side: every frame is sent as it comes.

The first face makes the first model packet: shape, mean texture, no modes.  What it cannot show of
the caller goes out as single modes while the stream flows on.  At times the model is learned again
from all that the call has taught and goes out as an update, announced some packets before the first
frame packet that needs it.

On a thin link the first model is a first layer only, and updates come in layers, too.
"""

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.calls.model_updates import Announcer, Place, Update
from encoder.calls.model_version import SPARE_MODES, Epoch, Learner
from encoder.calls.overload import Haste
from encoder.calls.session_stats import Tally
from encoder.capture.video_source import Capture
from encoder.coding.background import still_of
from encoder.coding.gop import Cadence
from encoder.coding.model_packet import Budget
from encoder.coding.progressive_model import UPDATE_LAYER_BYTES, LayerPacer
from encoder.coding.rate_control import LivePurse, Spending
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.iris import WIDER_CROP
from encoder.detection.landmark_indices import outline_of
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import find_network_folder
from encoder.learning.incremental_modes import Look
from encoder.learning.mode_scheduler import LiveModes
from encoder.learning.two_pass import Sampler
from encoder.runtime.parallel import threads_beside
from protocol.frames.temporal_prediction import FramePredictor
from protocol.link.interface import PacketSink
from protocol.packets import SEQUENCE_MODULUS, ControlKind, ControlPacket, FramePacket
from shared_model.parameters import FaceParameters
from shared_model.surround import surrounded_head

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# Seconds of the caller's face after which the model is learned, and what share of the budget for
# texture and modes it takes: nobody keeps the first ones for long.  Then again each time that what
# has been seen has doubled.
LEARN_AFTER_S = {1.0: 0.6, 5.0: 1.0, 12.0: 1.0, 25.0: 1.0, 45.0: 1.0}
# Frames to learn from, and up to twice as many; fewer where frames do not wait for what is learned:
# on average of seven clips these cost .02 dB, and half the time.
TRAINING_FRAMES, TRAINING_FRAMES_BESIDE = 24, 12
# A model's single modes are spent as this power of the time until the model is learned again: a
# quarter of it takes half of them.  On all 200 s of franck, .5 dB more than as soon as they can be
# learned, which leaves none for the second half of a minute and more; a power of .35 gave .4 dB.
SPENDING_POWER = 0.5
# Packets before an update holds from which on modes are learned for it: soon enough for the first
# of them to hold with it.  Until then they are for the model in use.
GROW_AHEAD = 1
# About how long single modes take to be learned beside frames: so much before a packet is full they
# are begun, since all frames of a packet have the modes that are there when it goes out.
GROWING_S = 0.12
# An update that the link carries within this time goes before single modes; on a thinner link it
# waits until they pause: a little soon is better than all of it late.
PATIENCE_S = 3.0
# What of the budget the first model takes: its still, and a mean that is soon replaced.
FIRST_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A face that waits for its packet to be full.  look: None where there was none to be seen."""

    face: FaceParameters
    look: Look | None = None


class LiveCall:
    """A call in the default profile, sent frame by frame.

    look_for_face_s: say so if there is no face after this many seconds of video.
    wait: learn before the next frame, so that the same source gives the same bytes; otherwise
        beside the frames, and a call that falls behind fits faces by texels only.
    pacer: sends models in layers; None: whole, at once.
    clock: seconds from anywhere.
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
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        folder = find_network_folder()
        self._tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), eye_crop=WIDER_CROP)
        self._capture, self._sink, self._tally = capture, sink, tally
        self._budget, self._look_for_face_s = budget, look_for_face_s
        self._head = surrounded_head()
        frames = TRAINING_FRAMES if wait else TRAINING_FRAMES_BESIDE
        self._sampler, self._points = Sampler(frames), dict[int, Array]()
        self._faces_seen = 0
        self._due = list(LEARN_AFTER_S.items())
        self._learned_after_s = 0.0  # of the update before
        self._pool: Executor | None = None if wait else threads_beside(2)
        # More would take the cores from the frames.
        self._workers = None if wait else 1
        self._learning: Future[Update] | None = None
        self._learner: Learner | None = None
        self._epoch: Epoch | None = None
        self._next: Epoch | None = None
        self._face: FaceParameters | None = None  # as it was last seen
        self._missed = 0  # frames without the face since one was last coded
        self._held = 0  # frames waiting that repeat an older face
        self._lost = False  # whether the decoder has been told
        self._number = 0  # of the next frame packet
        self._coded = 0  # source frames coded so far
        self._waiting: list[_Waiting] = []
        self._modes = LiveModes(float(capture.fps), self._pool)
        self._grows_next = False  # whether modes are learned for the next epoch
        self._predictor = FramePredictor(np.zeros((1, 5), np.uint8))
        self._cadence, self._fps = cadence, float(capture.fps)
        self._haste, self._clock = None if wait else Haste(1 / self._fps), clock
        self._announcer = Announcer(sink, tally, cadence, self._fps, pacer)
        fps = float(cadence.coded_fps(capture.fps))
        self._grow_before = 0 if wait else round(GROWING_S * fps)
        spending = Spending(bitrate, fps, cadence.frames_per_packet)
        self._purse = LivePurse(spending)

    @property
    def started(self) -> bool:
        """Whether a face has been found yet."""
        return self._epoch is not None

    def frame(self, index: int, frame: Picture, coming: Picture | None = None) -> None:
        """Find the face in source frame `index` and send what is due.

        coming: see `LandmarkTracker.update`.
        """
        begin, was_begun = self._clock(), self.started
        self._take(index, frame, coming)
        if self._haste is not None and was_begun:
            self._haste.spent(self._clock() - begin)

    def _take(self, index: int, frame: Picture, coming: Picture | None) -> None:
        with self._tally.stage("landmarks"):
            found = self._tracker.update(frame, coming)
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
            look = epoch.look(frame, found.points)
            with self._tally.stage("refine"):
                find = epoch.explain if self._hurries else epoch.find
                self._face = find(look, self._face)
            self._waiting.append(_Waiting(self._face, look))
            # Not by the epoch that modes are learned for.
            known = None if self._grows_next else self._face
            self._grow_on(index, replace(look, face=known))
            self._flush_if_full()
        self._learn_on()

    def end(self, frames: int) -> None:
        """Close a call of `frames` source frames."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        if self._epoch is not None:
            self._flush()
            self._announcer.end(self._epoch)
            if excess := self._purse.excess:
                self._tally.warn(excess)
            self._tally.send(self._sink, ControlPacket(0, ControlKind.END, frames))

    def _miss(self, index: int) -> None:
        self._tally.lost_frames += 1
        if self._epoch is None:
            if index / self._fps >= self._look_for_face_s:
                self._tally.warn(f"no face in the first {self._look_for_face_s:g} s; still looking")
            return
        assert self._face is not None
        self._missed += 1
        if self._is_coded(index):
            self._held += 1
            self._waiting.append(_Waiting(self._face))
            self._flush_if_full()

    def _is_coded(self, index: int) -> bool:
        return index == self._coded + len(self._waiting) * self._cadence.frame_step

    @property
    def _packet_frames(self) -> int:
        """How many frames the packet that is being filled takes."""
        assert self._epoch is not None
        return 1 if self._number == self._epoch.number else self._cadence.frames_per_packet

    @property
    def _hurries(self) -> bool:
        """Whether to leave out what can be left out."""
        return self._haste is not None and not self._haste.has_time

    def _flush_if_full(self) -> None:
        if len(self._waiting) == self._packet_frames:
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
            faces = [each.face for each in self._waiting]
            packet = self._purse.code(self._predictor, number, epoch.values(faces))
        self._predictor.anchor = packet.frames[-1]
        self._tally.frame_bytes += len(packet.payload)
        sequence = self._number % SEQUENCE_MODULUS
        self._tally.send(self._sink, FramePacket(sequence, packet.payload))
        frames = len(self._waiting)
        self._coded += frames * self._cadence.frame_step
        self._waiting.clear()
        self._held = 0
        self._number += 1
        self._go_over()
        size = 1 + len(packet.payload)
        self._next = self._announcer.packet_sent(size, frames, self._place) or self._next

    def _go_over(self) -> None:
        """To the next epoch, when it is time: modes first, then frames."""
        if self._next is None:
            return
        # In layers its own modes are still to come.
        ahead = 0 if self._announcer.in_layers else GROW_AHEAD
        if not self._grows_next and self._number >= self._next.number - ahead:
            self._modes.start(self._next)
            self._grows_next = True
        if self._number == self._next.number:
            self._enter(self._next)
            self._next, self._grows_next = None, False

    def _enter(self, epoch: Epoch) -> None:
        """Frames from here on are sent under `epoch`."""
        self._epoch = epoch
        components = epoch.all_components
        self._predictor = FramePredictor(components.spreads, components.spare)
        if self._face is not None:
            # Coefficients are of other modes now; the mean until the next refinement.
            blank = np.zeros(len(epoch.components.modes))
            self._face = replace(self._face, modes=blank)

    def _begin(self, index: int) -> None:
        """The first face: a model from this frame alone."""
        share = replace(
            self._budget, face_bytes=int(self._budget.face_bytes * FIRST_SHARE), most_modes=0
        )
        number, frame = self._sampler.frames[0]
        still = still_of(frame, outline_of(self._points[number]))
        self._learner = learner = Learner(
            self._head,
            self._capture,
            self._cadence,
            still,
            self._budget.background_bytes,
            self._workers,
        )
        self._coded = index
        epoch = learner.learn(share, *self._sample(), layer=0).at(0, index)
        if self._announcer.in_layers:
            # What else the first frame could teach, the update does better and is as large.
            epoch = learner.rough(epoch)
        self._enter(self._announcer.send(epoch))
        self._modes.start(epoch)

    def _grow_on(self, index: int, look: Look) -> None:
        """Learn single modes from what the call shows; use and send those that are learned."""
        if self._modes.wants(index):
            self._modes.look(index, look)
        if self._announcer.busy or (self._next is not None and self._announcer.in_layers):
            # What is sent is of the model to come.
            return
        if self._is_update_waiting and self._announcer.carried_s(self._budget) < PATIENCE_S:
            return
        epoch = self._next if self._grows_next else self._epoch
        assert epoch is not None
        due = len(self._waiting) + self._grow_before >= self._packet_frames
        with self._tally.stage("grow"):
            found = self._modes.grown(index, max(epoch.room - self._kept_room, 0), due)
        for mode in found:
            epoch = epoch.grown(mode)
            self._announcer.grow(epoch, mode.data)
        if self._grows_next:
            self._next = epoch
        else:
            self._epoch = epoch
            if found and not self._hurries:
                self._find_again(epoch)

    def _find_again(self, epoch: Epoch) -> None:
        """Find the faces of the packet that is being filled by the newest modes, too."""
        found: list[_Waiting] = []
        with self._tally.stage("refine"):
            for each in self._waiting:
                if each.look:
                    each = replace(each, face=epoch.redrawn(each.look, each.face))
                elif found:
                    # It repeats the face before.
                    each = replace(each, face=found[-1].face)
                found.append(each)
        self._waiting, self._face = found, found[-1].face

    @property
    def _is_update_waiting(self) -> bool:
        """Whether an update only waits for the link."""
        if self._learning is not None:
            return self._learning.done()
        return self._announcer.in_layers and self._is_due

    @property
    def _kept_room(self) -> int:
        """How many modes to keep for what is yet to come before the model is learned again."""
        if (self._learning is not None or self._next is not None) and not self._grows_next:
            # The model in use is about to be replaced.
            return 0
        until_s = self._due[0][0] - self._learned_after_s
        passed = (self._faces_seen / self._fps - self._learned_after_s) / until_s
        spent = math.pow(min(max(passed, 0.0), 1.0), SPENDING_POWER)
        return round(SPARE_MODES * (1 - spent))

    @property
    def _is_due(self) -> bool:
        """Whether it is time to learn again."""
        return self._faces_seen >= self._due[0][0] * self._fps

    def _next_share(self) -> float:
        """What share of the budget the update that is due takes; another is always to come."""
        after_s, share = self._due.pop(0)
        self._learned_after_s = after_s
        if not self._due:
            self._due.append((2 * after_s, share))
        return share

    def _learn_on(self) -> None:
        """Learn again when it is time; announce what was learned."""
        if self._learning is not None:
            if self._learning.done() and not self._announcer.busy:
                update, self._learning = self._learning.result(), None
                self._announce(update)
        elif self._is_due and self._next is None and not self._announcer.busy:
            epoch = self._epoch
            assert epoch is not None
            layer, share = epoch.model.layer + 1, self._next_share()
            # While layers were sent more than one may have become due.
            while self._announcer.in_layers and self._is_due:
                share = self._next_share()
            budget = replace(self._budget, face_bytes=int(share * self._budget.face_bytes))
            if not self._announcer.in_layers:
                budget = replace(budget, background_bytes=0)
            if self._pool is None:
                with self._tally.stage("learn"):
                    update = self._update(budget, *self._sample(), layer)
                self._announce(update)
            else:
                self._learning = self._pool.submit(self._update, budget, *self._sample(), layer)

    def _update(
        self, budget: Budget, pictures: Sequence[Picture], points: Sequence[Array], layer: int
    ) -> Update:
        """Model number `layer`, coded and ready to send: beside the frames all of it."""
        assert self._learner is not None
        epoch = self._learner.learn(budget, pictures, points, layer)
        if not self._announcer.in_layers:
            return Update(epoch, None)
        return Update(*self._learner.in_layers(epoch, UPDATE_LAYER_BYTES))

    def _announce(self, update: Update) -> None:
        self._next = self._announcer.announce(update, self._place)

    @property
    def _place(self) -> Place:
        single = self._epoch is not None and self._number == self._epoch.number
        return Place(self._number, self._coded, single)

    def _sample(self) -> tuple[list[Picture], list[Array]]:
        """Some of the frames so far, and their landmarks."""
        self._points = {number: self._points[number] for number, _ in self._sampler.frames}
        return [frame for _, frame in self._sampler.frames], list(self._points.values())
