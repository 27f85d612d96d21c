"""The process that receives a person: packets of the call in, faces and sound out; and pictures,
where a page cannot draw them."""

import os
import time
from collections import deque
from collections.abc import Callable
from threading import Lock

import numpy as np

from decoder.call_pictures import CallPictures, DrawnFrame
from decoder.playout.call_source import CallSource
from decoder.playout.playout import PlayoutFrame
from decoder.sound.sound_track import SoundTrack, open_sound_track
from protocol.call_file import CallReader
from protocol.call_parameters import CallParameters
from protocol.link.carriers import open_link_source
from protocol.link.interface import Arrival, PacketSource
from protocol.model_packet import ModelPacket
from risorius.call_page.face_message import face_values
from risorius.call_page.numbered_models import NumberedModels
from risorius.live_call.messages import (
    Draw,
    DrawingOptions,
    Drawn,
    Heard,
    Presence,
    Receiving,
    ShownFace,
    ShownModel,
    ToDrawer,
    Trouble,
)
from risorius.live_call.packets.recorder import CallRecorder
from risorius.live_call.packets.traffic_meter import MeteredSource, StampedSource, TrafficMeter
from risorius.live_call.thinning import Thinning, frame_step
from risorius.live_call.worker_connection import WorkerConnection
from runtime.image_ops import jpeg
from runtime.parallel import lower_priority_of_process
from shared_model.arrays import Samples
from shared_model.errors import LINK_FAILED, UserError

# No packet for so long: the link is lost, or the other end is.
SILENT_S = 2.5
# Seconds of which losses are counted.
LOSS_S = 10
# Samples that are no louder are silence.
SILENT_LEVEL = 30
# The sound of so many source frames after the one that is drawn may be known already.
MAX_AHEAD = 64
# How long to wait before the next try of a link.
RETRY_S = 1.0


def run(worker: WorkerConnection, options: DrawingOptions) -> None:
    """Draw one call after the other until the process of the page is gone.

    Raises `UserError` if the link cannot be made the first time.
    """
    if options.link is None:
        # The picture of oneself stands back behind the other workers of a call.
        lower_priority_of_process()
    drawing = _Drawing(worker, options)
    worker.in_background(drawing.obey)
    worker.every_second(drawing.figures)
    try:
        drawing.run()
    finally:
        drawing.recorder.close()


class _Drawing:
    def __init__(self, worker: WorkerConnection, options: DrawingOptions) -> None:
        self._worker, self._options = worker, options
        self._meter, self.recorder = TrafficMeter(), CallRecorder(worker.send)
        self._presence = Presence.AWAITED
        self._thinning = Thinning(options.fps, time.monotonic)
        self._faces = ShownFaces(worker.send, options.fps)
        self._pictures: CallPictures | None = None
        self._sound: SoundTrack | None = None
        self._sound_start: int | None = None  # source frame of its beginning
        self._losses = deque[tuple[int, int]](maxlen=LOSS_S)  # lost and all, each second
        self._lock = Lock()  # of the losses

    def run(self) -> None:
        """Draw until the worker is over."""
        source = self._open()
        while True:
            self._draw(source)
            if self._options.link is None or self._worker.is_over.is_set():
                return
            if self._presence is not Presence.AWAITED:
                self._presence = Presence.LEFT
            self._worker.send(self.figures())
            source = self._open_again()

    def obey(self) -> None:
        """Do what comes from the page until it is gone."""
        self._worker.obey(self._do)

    def figures(self) -> Receiving:
        """How it goes, since the last time; for any thread."""
        with self._lock:
            return self._figures()

    def _figures(self) -> Receiving:
        traffic, pictures = self._meter.take(), self._pictures
        if self._presence in (Presence.HERE, Presence.SILENT):
            last_s = self._meter.last_s
            silent = last_s is not None and time.monotonic() - last_s > SILENT_S
            self._presence = Presence.SILENT if silent else Presence.HERE
        covered_s, is_camera_off = 0.0, False
        if pictures is not None and (model := pictures.receiver.model) is not None:
            receiver, covered_s = pictures.receiver, packet_s(model.call)
            is_camera_off = receiver.heard.playout.is_camera_off
            # What a busy host takes too late has come: the link has not lost it.
            counts = receiver.counts
            self._losses.append((max(0, counts.lost - counts.late), traffic.packets))
        return Receiving(traffic, self._presence, self._lost_share, covered_s, is_camera_off)

    def _do(self, message: ToDrawer) -> None:
        if isinstance(message, Draw):
            self._faces.draw_here(message.on)
        else:
            self.recorder.record(message.path)

    @property
    def _lost_share(self) -> float:
        if len(self._losses) < 2:
            return 0.0
        lost = self._losses[-1][0] - self._losses[0][0]
        came = sum(count for _, count in self._losses)
        return max(0, lost) / max(1, lost + came)

    def _open(self) -> PacketSource:
        link = self._options.link
        if link is None:
            assert self._worker.pipe is not None
            return StampedSource(CallReader(os.fdopen(self._worker.pipe, "rb")))
        return open_link_source(link, self._worker.tell_of_link)

    def _open_again(self) -> PacketSource:
        while True:
            try:
                return self._open()
            except UserError:
                if self._worker.is_over.wait(RETRY_S):
                    raise

    def _draw(self, opened: PacketSource) -> None:
        """Draw one call."""
        self.recorder.forget()
        with self._lock:
            self._losses.clear()
        source = MeteredSource(opened, self._meter, self._note)
        self._thinning = Thinning(self._options.fps, time.monotonic)
        options, stop = CallSource(link=self._options.link), self._worker.is_over.is_set
        self._sound = self._sound_start = None
        try:
            drawing = CallPictures(
                options, stop, source=source, wants=self._wants, observer=self._faces
            )
            with drawing as pictures:
                self._pictures = pictures
                for frame in pictures:
                    self._show(frame)
        except UserError as error:
            if error.exit_code != LINK_FAILED and not stop():
                self._worker.send(Trouble(str(error)))
        finally:
            self._pictures = None

    def _wants(self, index: int) -> bool:
        """Whether to draw the picture of source frame `index`; the sound does not wait for that."""
        pictures = self._pictures
        assert pictures is not None
        if self._sound_start is None:
            self._sound = open_sound_track(pictures.receiver.speech, pictures.sender, index)
            self._sound_start = index
        if self._sound is not None:
            self._speak(self._sound, pictures, index)
        self._thinning.arrival_s = pictures.arrival_s
        return self._thinning.wants(index, pictures.sender.fps)

    def _note(self, arrival: Arrival) -> None:
        self._presence = Presence.HERE
        self.recorder.add(arrival.data, arrival.number, arrival.session)

    def _show(self, frame: DrawnFrame) -> None:
        data = jpeg(frame.picture)
        made_ms, arrival_s = 1000 * time.time(), self._thinning.arrival_s
        waited_s = 0.0 if arrival_s is None else time.monotonic() - arrival_s
        state = round(1000 * waited_s), frame.frozen, frame.lost
        self._worker.send(Drawn(frame.index, float(frame.time_s), made_ms, *state, data))

    def _speak(self, sound: SoundTrack, pictures: CallPictures, index: int) -> None:
        """Send all the sound that is known.  index: of the picture that is drawn next."""
        first = self._sound_start or 0
        start_s = first / pictures.sender.fps + sound.written / sound.rate_hz
        most = index + 1 - first + MAX_AHEAD
        samples = sound.take(most, pictures.receiver.speech.received_until)
        heard = samples[leading_silence(samples) :]
        if len(heard):
            start_s += (len(samples) - len(heard)) / sound.rate_hz
            self._worker.send(Heard(start_s, sound.rate_hz, heard.tobytes()))


def leading_silence(samples: Samples) -> int:
    """How many samples of sound, (n,) int16, are silent in front.

    That a packet ends in silence shows only when the next one has come: nobody waits for that.
    """
    loud = np.flatnonzero(np.abs(samples.astype(np.int32)) > SILENT_LEVEL)
    return int(loud[0]) if len(loud) else len(samples)


def packet_s(call: CallParameters) -> float:
    """The time that a packet of a call covers, seconds."""
    return call.frames_per_packet * call.frame_step / call.fps


class ShownFaces:
    """A `FaceObserver` that sends on what it sees.

    fps: faces a second that are wanted, about; None: all.
    """

    def __init__(self, send: Callable[[ShownModel | ShownFace], None], fps: float | None) -> None:
        self._send, self._fps = send, fps
        self._is_drawn_here = False
        self._models = NumberedModels(lambda number, packet: send(ShownModel(number, packet)))

    @property
    def wants_pictures(self) -> bool:
        """See `FaceObserver`; pages do not draw a picture residual."""
        model = self._models.newest
        return self._is_drawn_here or (model is not None and model.call.has_residual)

    def draw_here(self, is_drawn: bool) -> None:
        """Draw pictures besides, or not any more."""
        self._is_drawn_here = is_drawn

    def see_model(self, model: ModelPacket) -> None:
        """See `FaceObserver`."""
        self._models.number_of(model)

    def see_frame(self, frame: PlayoutFrame, arrival_s: float) -> None:
        """See `FaceObserver`."""
        if frame.index % frame_step(frame.model.call.fps, self._fps):
            return
        number, waited_s = self._models.number_of(frame.model), time.monotonic() - arrival_s
        when = frame.index, float(frame.time_s), 1000 * time.time(), round(1000 * waited_s)
        state = frame.frozen, frame.lost, number, frame.presence
        self._send(ShownFace(*when, *state, face_values(frame.face)))
