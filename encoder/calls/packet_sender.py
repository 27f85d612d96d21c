"""Sends the packets of one call and counts them; all three sessions send through it."""

import logging
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial

from encoder.calls.live_residual import LiveResidual
from encoder.calls.send_queue import SendQueue
from encoder.calls.session_stats import SessionStats
from encoder.capture.frame_times import FrameTimes
from encoder.coding.pacer import LayerPacer
from encoder.coding.progressive_model import LayeredModel
from encoder.live_model.pacing import REAL_TIME
from encoder.sound.voice_packer import VoicePacker
from protocol.frames.frame_times import TimesPacket
from protocol.limits import MAX_TIMED_FRAMES, SEQUENCE_MODULUS
from protocol.link.interface import PacketSink
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    Packet,
    serialise,
)
from shared_model.arrays import Picture

_log = logging.getLogger(__name__)

# Frame packets between a model update and the first one that needs it, at least and at most: any
# more, and its sequence number would be taken for one of the past.
LEAD_PACKETS, MAX_LEAD_PACKETS = REAL_TIME.lead_packets, SEQUENCE_MODULUS // 2 - 1


class PacketSender:
    """Serialises, sends and counts packets.

    pacer: holds all packets together to the start-up bitrate; None: each goes at once.
    times: of the source's frames; None: their rate is constant.
    voice: adds the voice to frame packets; None: the call has none.
    residual: adds the picture residual to those of a live call; None: it has none.
    clock: seconds from any origin.
    """

    def __init__(
        self,
        sink: PacketSink,
        stats: SessionStats,
        pacer: LayerPacer | None = None,
        times: FrameTimes | None = None,
        voice: VoicePacker | None = None,
        residual: LiveResidual | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._sink, self._stats, self._pacer, self._voice = sink, stats, pacer, voice
        self._residual, self._queue = residual, SendQueue(clock)
        self._times, self._timed_frames = times, 0
        self._face_visible = self._camera_on = True
        self._person_gone = False

    @property
    def pacer(self) -> LayerPacer | None:
        """What paces the layers of the model; None: it is sent whole."""
        return self._pacer

    def send_model(self, packet: ModelPacket) -> None:
        """Send a model packet, whole or the base layer of one."""
        if self._residual is not None:
            packet = self._residual.add_model(packet)
        self._queue.put(partial(self._send_model, packet))

    def _send_model(self, packet: ModelPacket) -> None:
        size = self._send_model_part(packet)
        _log.info("model %d is sent, %d bytes", packet.version, size)
        if self._pacer is not None:
            self._pacer.on_packet_sent(size)

    def begin_layers(self, model: LayeredModel) -> None:
        """From now on send the layers of `model` between frame packets."""
        if self._pacer is not None:
            self._pacer.start(model)

    def send_layer(self, packet: LayerPacket) -> None:
        """Send a layer packet, which no pacer holds back."""
        if self._residual is not None:
            self._residual.add_packet(packet)
        self._queue.put(partial(self._send_model_part, packet))

    def add_source(self, index: int, picture: Picture) -> None:
        """See `LiveResidual`; of no effect where the call has no residual."""
        if self._residual is not None:
            self._residual.add_source(index, picture)

    def send_frames(
        self,
        number: int,
        payload: bytes,
        duration_s: float,
        covered: range = range(0),
        has_time: bool = True,
    ) -> None:
        """Send frame packet `number` of the call, then the layers that are due.

        duration_s: from the packet's first frame to that of the next.
        covered: the source frames of which it has the residual, if the call has one.
        has_time: whether there is time for a residual.
        """
        coded = None
        if self._residual is not None:
            with self._stats.stage("residual"):
                coded = self._residual.begin_packet(number, payload, covered, duration_s, has_time)
        self._queue.put(partial(self._send_frames, number, payload, duration_s, coded), coded)

    def send_waiting(self) -> None:
        """Send the packets that have waited for their residual for long enough."""
        self._queue.send_due()

    def _send_frames(
        self, number: int, face: bytes, duration_s: float, coded: "Future[bytes] | None"
    ) -> None:
        payload = face if self._residual is None else self._residual.payload(coded, face)
        self._stats.sent.frame_bytes += len(payload)
        _log.debug("frame packet %d is sent, %d bytes", number, len(payload))
        packet = FramePacket(number % SEQUENCE_MODULUS, payload)
        if self._voice is not None:
            packet = self._voice.packet(number, payload)
        self._send_frame(packet)
        if self._pacer is not None:
            self._pacer.on_packet_sent(1 + len(packet.payload))
            for layer in self._pacer.packets_due(duration_s):
                self._send_model_part(layer)

    def send_times(self, frame: int) -> None:
        """Send the times of source frames up to `frame`, where the rate varies.

        To be called before the packet with the face of that frame.
        """
        while self._times is not None and self._timed_frames <= frame:
            packet = self._times.packet(self._timed_frames)
            self._timed_frames += MAX_TIMED_FRAMES
            if packet is not None:
                self._send_in_order(packet)

    def report_face(self, visible: bool, frame: int) -> bool:
        """Send FACE_LOST or FACE_FOUND for source frame `frame`, if that is news; whether it is."""
        if visible == self._face_visible:
            return False
        self._face_visible, self._person_gone = visible, False
        if visible and self._voice is not None:
            self._queue.put(partial(self._voice.resume, frame))
        self._say(ControlKind.FACE_FOUND if visible else ControlKind.FACE_LOST, frame)
        return True

    @property
    def face_is_lost(self) -> bool:
        """Whether FACE_LOST is the newest that was said of the face."""
        return not self._face_visible

    def report_absence(self, frame: int) -> None:
        """Send PERSON_GONE for source frame `frame` of a lost face, if that is news."""
        if not self._face_visible and not self._person_gone:
            self._person_gone = True
            self._say(ControlKind.PERSON_GONE, frame)

    def _say(self, kind: ControlKind, frame: int) -> None:
        _log.info("%s from source frame %d on", kind.name, frame)
        self._stats.events.append((kind, frame))
        self._send_in_order(ControlPacket(0, kind, frame))

    def report_camera(self, on: bool, frame: int) -> None:
        """Send CAMERA_OFF or CAMERA_ON for source frame `frame`, if that is news."""
        if on != self._camera_on:
            self._camera_on = on
            kind = ControlKind.CAMERA_ON if on else ControlKind.CAMERA_OFF
            self._send_in_order(ControlPacket(0, kind, frame))

    def send_voice_alone(self, frame: int) -> None:
        """Send the voice that is due up to source frame `frame`, which shows no face."""
        self._queue.put(partial(self._send_voice_alone, frame))

    def _send_voice_alone(self, frame: int) -> None:
        if self._voice is not None:
            for packet in self._voice.packets_without_face(frame):
                self._send_frame(packet)

    def end(self, frames: int) -> None:
        """Close a call of `frames` source frames."""
        self._queue.send_all()
        if self._residual is not None and (missed := self._residual.missed_message):
            self._stats.missed_residuals = self._residual.missed
            self._stats.warn(missed)
        self._stats.frames = frames
        if self._voice is not None:
            for packet in self._voice.last_packets(frames):
                self._send_frame(packet)
        self._send(ControlPacket(0, ControlKind.END, frames))

    def warn_of_incomplete_model(self) -> None:
        """Add a warning if not all layers of the model have been sent."""
        if self._pacer is not None and self._pacer.pending_items:
            self._stats.warn(
                f"the call ended with {self._pacer.pending_items} pictures of its model not sent:"
                f" it was too short for {self._pacer.bitrate:.0f} bit/s"
            )

    def _send_model_part(self, packet: ModelPacket | LayerPacket) -> int:
        """Send what counts as model; returns the bytes of the packet."""
        if self._voice is not None and isinstance(packet, ModelPacket):
            packet = self._voice.model(packet)
        size = len(serialise(packet))
        self._stats.sent.model_bytes += size - 1
        self._send(packet)
        return size

    def _send_frame(self, packet: FramePacket) -> None:
        self._send(packet)
        if self._voice is not None:
            self._stats.speech.voice_bytes = self._voice.voice_bytes

    def _send_in_order(self, packet: ControlPacket | TimesPacket) -> None:
        """Send a packet that stands between two of frames."""
        if self._residual is not None:
            self._residual.add_packet(packet)
        self._queue.put(partial(self._send, packet))

    def _send(self, packet: Packet) -> None:
        with self._stats.stage("send"):
            self._sink.send(serialise(packet))
        self._stats.sent.packets += 1
