"""The process that sends this person: camera and microphone in, packets of the call out."""

import os
from contextlib import ExitStack
from threading import Event
from typing import BinaryIO

from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.live_model.other_face import OtherFace
from encoder.options import EncodeOptions
from encoder.packet_sink import open_packet_sink
from encoder.pipeline import EncodeRun, encode_live
from protocol.link.interface import MessageCallback, PacketSink
from protocol.packets import PacketKind, packet_kind
from risorius.live_call.devices import Devices
from risorius.live_call.messages import (
    WARMING_UP,
    Device,
    Record,
    Sending,
    SendingOptions,
    Switch,
    ToSender,
)
from risorius.live_call.packets.recorder import CallRecorder
from risorius.live_call.packets.traffic_meter import MeteredSink, TrafficMeter
from risorius.live_call.worker_connection import WorkerConnection
from runtime.parallel import short_switch_interval
from shared_model.errors import NO_FACE, UserError


def run(worker: WorkerConnection, options: SendingOptions) -> None:
    """Send until the process of the page is gone, or says so.

    Raises `UserError` if the camera, the voice or the link cannot be opened.
    """
    with ExitStack() as stack:
        stack.enter_context(short_switch_interval())
        face_on = Event()
        if options.media.face_on:
            face_on.set()
        recorder = CallRecorder(worker.send)
        stack.callback(recorder.close)
        devices = stack.enter_context(Devices(options.media))
        worker.in_background(lambda: _obey(worker, devices, recorder, face_on))
        monitor = None
        if worker.pipe is not None:
            monitor = stack.enter_context(os.fdopen(worker.pipe, "wb", buffering=0))
        sent = _Sent(options, monitor, devices, recorder, stack, worker.tell_of_link)
        worker.every_second(sent.figures)
        capture = devices.capture()
        if capture is None:
            return
        face = options.media.face
        callbacks = SessionCallbacks(
            lambda done, total: None,
            worker.is_over.is_set,
            on_preparing=sent.prepare,
            other_face=None if face is None else OtherFace(face, face_on.is_set),
        )
        try:
            run = EncodeRun(sent.options, capture, sent.stats, callbacks)
            encode_live(run, sent.sink, devices.voice)
        except UserError as error:
            if not (worker.is_over.is_set() and error.exit_code == NO_FACE):
                raise


def _obey(
    worker: WorkerConnection, devices: Devices, recorder: CallRecorder, face_on: Event
) -> None:
    """Do what comes from the page until it is gone; then there is no camera any more."""

    def do(message: ToSender) -> None:
        if isinstance(message, Record):
            recorder.record(message.path)
        elif isinstance(message, Switch) and message.device is Device.FACE:
            face_on.set() if message.on else face_on.clear()
        else:
            devices.receive(message)

    try:
        worker.obey(do)
    finally:
        devices.close()


class _Sent:
    """What goes over the link.  Raises `UserError` if that cannot be made."""

    def __init__(
        self,
        options: SendingOptions,
        monitor: BinaryIO | None,
        devices: Devices,
        recorder: CallRecorder,
        stack: ExitStack,
        on_message: MessageCallback,
    ) -> None:
        self.options = EncodeOptions(
            options.media.camera,
            monitor=monitor,
            link=options.link,
            bitrate=options.media.bitrate,
            low_delay=options.media.low_delay,
            two_way=True,
            live=True,
        )
        self.stats, self._devices = SessionStats(keeps_times=False), devices
        self._face, self._meter, self._recorder = SentFace(), TrafficMeter(), recorder
        opened = open_packet_sink(self.options, stack, on_message)
        self.sink: PacketSink = MeteredSink(opened, self._meter, self._note)

    def prepare(self, what: str) -> None:
        """Note what the encoder prepares; "": it is ready."""
        self._face.preparing = what

    def figures(self) -> Sending:
        """How it goes, since the last time."""
        quality = self.sink.quality
        return Sending(
            traffic=self._meter.take(),
            reach=str(self.sink.reachability),
            loss=quality.loss,
            round_trip_s=quality.round_trip_s,
            face=self._face.words,
            begun_s=self._devices.begun_s,
            fps=float(self._devices.fps),
        )

    def _note(self, packet: bytes) -> None:
        self._face.add(packet)
        self._recorder.add(packet)


class SentFace:
    """Gets every packet of a live call.

    preparing: what the encoder prepares before it looks for a face; "": nothing.
    words: for the user.
    """

    def __init__(self) -> None:
        self.preparing = WARMING_UP
        self._models = self._details = 0

    def add(self, packet: bytes) -> None:
        """Take a serialised packet."""
        kind = packet_kind(packet)
        if kind is PacketKind.MODEL:
            self._models += 1
        elif kind is PacketKind.LAYER:
            self._details += 1

    @property
    def words(self) -> str:
        """See the class."""
        if not self._models:
            return self.preparing or "looking for your face"
        times = "" if self._models == 1 else f" {self._models} times"
        return f"face learned{times}, {self._details} details"
