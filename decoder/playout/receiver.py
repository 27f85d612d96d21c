"""The receiving end of a call, sans-IO: what arrives in any order, and time, become faces in order.

Frame packets of a link are put in order and waited for; those of a call file, which have no number,
are taken as they come.  Where an encoder starts again the call goes on with its new model, in the
place where it would be had nothing happened.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction

from decoder.playout.arrival_clock import MAX_WAIT_S
from decoder.playout.concealment import SmoothReturn
from decoder.playout.encoder_session import EncoderSession
from decoder.playout.playout import PlayoutFrame
from decoder.playout.received_models import picture_of
from decoder.sound.speech_frames import CallSpeech, SpeechFrames
from protocol.errors import ProtocolError
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, Packet, parse_packet
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND
from shared_model.errors import LINK_FAILED, UserError
from shared_model.parameters import FaceParameters, with_focal_change

_log = logging.getLogger(__name__)

# Speech is heard with its pictures; what nobody has taken by then is kept for so long.
KEPT_SPEECH_S = 60


@dataclass(slots=True)
class CallCounts:
    """What is counted of a call, its encoder's starts taken together.

    model_bytes: payload of the model's packets; frame_bytes: of frame packets, `voice_bytes` of
        voice among them.
    lost, late: frame packets that were missing when they were due, that came too late or twice.
    restarts: how often the encoder has started again.
    """

    model_bytes: int = 0
    frame_bytes: int = 0
    voice_bytes: int = 0
    lost: int = 0
    late: int = 0
    restarts: int = 0


def raise_damage(error: ProtocolError) -> None:
    """Raise it."""
    raise error


class Receiver:
    """Turns the arrivals of a call into the faces of its source frames, in order.

    max_wait_s: how long a missing packet is waited for, at most.
    kept_speech_s: how long speech that has not been taken is kept after its pictures.
    on_damage: called with what is wrong with a packet that is damaged or contradicts the call;
        the others take effect.
    first, shown, heard: the encoder's first start, the one whose frames are shown, and the newest.
    next_frame: the source frame to show next.  speech: the speech received.
    """

    def __init__(
        self,
        max_wait_s: float = MAX_WAIT_S,
        kept_speech_s: int = KEPT_SPEECH_S,
        on_damage: Callable[[ProtocolError], None] = raise_damage,
    ) -> None:
        self._max_wait_s, self._kept_speech_s = max_wait_s, kept_speech_s
        self._on_damage = on_damage
        self.counts = CallCounts()
        self.first = self.shown = self.heard = EncoderSession(max_wait_s)
        self.first.offset = 0
        self.speech = CallSpeech(self.first.voice.speech)
        self.next_frame = 0
        self._session = 0
        self._return = SmoothReturn()
        self._focal_px = 0.0  # of the face shown last

    @property
    def model(self) -> ModelPacket | None:
        """The model of the newest frames; before any, of the encoder that is heard."""
        return self.shown.playout.model or self.heard.playout.model

    @property
    def next_model(self) -> ModelPacket | None:
        """The model of later frames, where it has been received already."""
        return self.heard.playout.next_model or self.heard.playout.model

    @property
    def ended(self) -> bool:
        """The END packet has been received."""
        return self.heard.playout.ended

    @property
    def release_s(self) -> float | None:
        """When `poll` may have something to show, if nothing arrives before; None: not known."""
        return self.heard.release_s

    def receive(self, arrival: Arrival) -> list[PlayoutFrame]:
        """The frames that can be shown after an arrival, perhaps none.

        Raises `UserError` if the encoder has come back with other pictures.
        """
        if arrival.session < self._session:
            return []
        if arrival.session > self._session:
            self._start_again(arrival.session)
        try:
            packet = parse_packet(arrival.data)
            self._count(packet, len(arrival.data) - 1)
            self.heard.enter(packet, arrival)
        except ProtocolError as error:
            _log.warning("a packet of %d bytes is left out: %s", len(arrival.data), error)
            self._on_damage(error)
        frames = self._released(arrival.time_s)
        self._drop_old_speech()
        return frames

    def poll(self, now_s: float) -> list[PlayoutFrame]:
        """The frames to show at `now_s` although nothing has come.  Raises as `receive`."""
        frames = self._released(now_s)
        due = self.shown.frame_due(now_s)
        if due is not None and not self.shown.playout.is_frozen and not self.ended:
            frames += self._held_until((self.shown.offset or 0) + due)
        return frames

    def _start_again(self, session: int) -> None:
        """Take packets from an encoder that has started again."""
        self.heard, self._session = EncoderSession(self._max_wait_s), session
        self.counts.restarts += 1
        _log.info("the encoder has started again, session %d", session)

    def _count(self, packet: Packet, size: int) -> None:
        if isinstance(packet, ModelPacket | LayerPacket):
            self.counts.model_bytes += size
            _log.info("%s of %d bytes has come", type(packet).__name__, size)
        elif isinstance(packet, FramePacket):
            self.counts.frame_bytes += size

    def _released(self, now_s: float) -> list[PlayoutFrame]:
        """The frames of all packets whose turn it is, with their place in the call."""
        session, frames = self.heard, list[PlayoutFrame]()
        counted = session.playout.lost, session.playout.late, session.voice.voice_bytes
        while session.is_ready(now_s):
            try:
                shown = session.take(now_s)
            except ProtocolError as error:
                self._on_damage(error)
                continue
            for frame in shown:
                frames += self._placed(session, frame)
            if repaired := session.playout.take_repaired():
                self._return.correct(repaired)
        self.counts.lost += session.playout.lost - counted[0]
        self.counts.late += session.playout.late - counted[1]
        self.counts.voice_bytes += session.voice.voice_bytes - counted[2]
        return frames

    def _placed(self, session: EncoderSession, frame: PlayoutFrame) -> list[PlayoutFrame]:
        """A session's frame in its place in the call, behind those that are held up to there."""
        call, held = frame.model.call, list[PlayoutFrame]()
        if session.offset is None:
            if frame.index < call.start_frame:
                return []
            session.offset = self._offset_of(session, frame)
            held = self._held_until(session.offset + frame.index)
            self._return.interrupt()
            self._go_on_speaking(session, call.exact_fps)
            self.shown = session
        index, time_s = session.offset + frame.index, session.offset / call.exact_fps + frame.time_s
        self.next_frame = index + 1
        face = self._smoothed(frame.face, call.focal_px)
        return [*held, replace(frame, index=index, face=face, time_s=time_s)]

    def _held_until(self, end: int) -> list[PlayoutFrame]:
        """The face shown last, as lost, for every source frame before `end`."""
        face, session, frames = self._return.shown, self.shown, list[PlayoutFrame]()
        if face is None or session.playout.model is None:
            return frames
        model, offset = session.playout.model, session.offset or 0
        while self.next_frame < end:
            index, self.next_frame = self.next_frame, self.next_frame + 1
            self._return.interrupt()
            session.playout.skip_to(self.next_frame - offset)
            time_s = offset / model.call.exact_fps + session.playout.time_of(index - offset, model)
            frames.append(PlayoutFrame(index, face, model, time_s, frozen=True, lost=True))
        return frames

    def _smoothed(self, face: FaceParameters, focal_px: float) -> FaceParameters:
        shown = self._return.shown
        if shown is not None and focal_px != self._focal_px:
            self._return.shown = with_focal_change(shown, focal_px / self._focal_px)
        self._focal_px = focal_px
        return self._return.show(face)

    def _offset_of(self, session: EncoderSession, first: PlayoutFrame) -> int:
        """The offset of a session whose first picture is this one.  Raises `UserError`."""
        if self.shown.playout.model is None:
            return 0
        before, after = self.shown.playout.model.call, first.model.call
        if picture_of(before) != picture_of(after):
            raise UserError(
                f"the encoder came back with pictures of {after.width}x{after.height} at"
                f" {after.fps:g}/s, before they were {before.width}x{before.height} at"
                f" {before.fps:g}/s: decode it anew",
                LINK_FAILED,
            )
        starts_s = self.shown.clock.start_s, session.clock.start_s
        elapsed = 0
        if starts_s[0] is not None and starts_s[1] is not None:
            elapsed = (self.shown.offset or 0) + round((starts_s[1] - starts_s[0]) * before.fps)
        return max(elapsed, self.next_frame - first.index)

    def _go_on_speaking(self, session: EncoderSession, fps: Fraction) -> None:
        """Hear another start of the encoder from the next frame on."""
        assert session.offset is not None
        per_frame = SPEECH_FRAMES_PER_SECOND / fps
        is_same = session.voice.voice == self.shown.voice.voice
        is_same |= self.shown.playout.model is None
        # The decoder of the one before would not understand another codec.
        speech = session.voice.speech if is_same else SpeechFrames()
        start, offset = round(self.next_frame * per_frame), round(session.offset * per_frame)
        self.speech.go_on(speech, start, offset)

    def _drop_old_speech(self) -> None:
        if (model := self.model) is None:
            return
        shown = int(self.next_frame * SPEECH_FRAMES_PER_SECOND / model.call.exact_fps)
        old = shown - self._kept_speech_s * SPEECH_FRAMES_PER_SECOND
        # What follows is not known yet before a pause: nobody could have taken the last words.
        self.speech.drop_before(min(old, self.speech.known_until))
