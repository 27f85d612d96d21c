"""The play-out of a whole call: what its encoder and the link do to it is bridged.

Frame packets of a link are put in order and waited for; those of a call file, which have no number,
are taken as they come.  Where an encoder starts again the call goes on with its new model, in the
place where it would be had nothing happened.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

from decoder.playout.arrival_clock import MAX_WAIT_S
from decoder.playout.concealment import SmoothReturn
from decoder.playout.encoder_session import EncoderSession
from decoder.playout.model_versions import picture_of
from decoder.playout.playout import PlayoutFrame
from decoder.sound.call_speech import CallSpeech
from decoder.sound.speech_frames import SpeechFrames
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND
from shared_model.errors import LINK_FAILED, UserError
from shared_model.parameters import FaceParameters, with_focal_change

# Speech is heard with its pictures; what nobody has taken by then is kept for so long.
KEPT_SPEECH_S = 60


@dataclass(slots=True)
class _PastSessions:
    """What was counted of sessions that are over."""

    lost: int = 0
    late: int = 0
    voice_bytes: int = 0

    def add(self, session: EncoderSession) -> None:
        self.lost += session.playout.lost
        self.late += session.playout.late
        self.voice_bytes += session.voice.voice_bytes


class CallPlayout:
    """Turns the arrivals of a call into the faces of its source frames, in order.

    max_wait_s: how long a missing packet is waited for, at most.
    kept_speech_s: how long speech that has not been taken is kept after its pictures.
    speech: the speech received.
    Attributes are those of `Playout`, of the whole call.
    """

    def __init__(self, max_wait_s: float = MAX_WAIT_S, kept_speech_s: int = KEPT_SPEECH_S) -> None:
        self._max_wait_s, self._kept_speech_s = max_wait_s, kept_speech_s
        self._return = SmoothReturn()
        self._receiving = self._shown = EncoderSession(max_wait_s)
        self._receiving.offset = 0
        self._session = self._restarts = 0
        self._next = 0  # index in the call of the frame to show next
        self._focal_px = 0.0  # of the face shown last
        # The first session, the one that is shown and the one that is heard; of the others counts.
        self._sessions = [self._receiving]
        self._past = _PastSessions()
        self.speech = CallSpeech(self._receiving.voice.speech)

    @property
    def model(self) -> ModelPacket | None:
        """The model of the newest frames; before any, of the encoder that is heard."""
        return self._shown.playout.model or self._receiving.playout.model

    @property
    def next_model(self) -> ModelPacket | None:
        """The model of later frames, where it has been received already."""
        return self._receiving.playout.next_model or self._receiving.playout.model

    @property
    def ended(self) -> bool:
        """The END packet has been received."""
        return self._receiving.playout.ended

    @property
    def is_camera_off(self) -> bool:
        """The sender has switched the camera off."""
        return self._receiving.playout.is_camera_off

    @property
    def joined_late(self) -> bool:
        """The call was under way before its first packet."""
        return self._sessions[0].playout.joined_late

    @property
    def is_constant_rate(self) -> bool:
        """Source frames follow each other at the rate of the call."""
        return self._shown.playout.clock.is_constant

    def time_s(self, index: int) -> Fraction:
        """Time of the frame shown last, `index`, in the call, seconds, once there is a model."""
        assert self.model is not None
        fps, offset = self.model.call.exact_fps, self._shown.offset or 0
        return offset / fps + self._shown.playout.clock.time_s(index - offset, fps)

    @property
    def next_frame(self) -> int:
        """The source frame to show next."""
        return self._next

    @property
    def restarts(self) -> int:
        """How often the encoder has started again."""
        return self._restarts

    @property
    def lost(self) -> int:
        """Frame packets that were missing when they were due."""
        return self._past.lost + sum(each.playout.lost for each in self._sessions)

    @property
    def late(self) -> int:
        """Frame packets that came too late or twice."""
        return self._past.late + sum(each.playout.late for each in self._sessions)

    @property
    def voice_bytes(self) -> int:
        """So many bytes of the frame packets were voice."""
        return self._past.voice_bytes + sum(each.voice.voice_bytes for each in self._sessions)

    @property
    def before_join(self) -> int:
        """Source frames shown that precede the first frame packet."""
        return self._sessions[0].playout.before_join

    @property
    def release_s(self) -> float | None:
        """When `poll` may have something to show, if nothing arrives before; None: not known."""
        return self._receiving.buffer.release_s

    def receive(self, arrival: Arrival) -> Iterator[PlayoutFrame]:
        """The frames that can be shown after an arrival, perhaps none.

        The arrival takes effect as the iterator is consumed.
        Raises `ProtocolError` if it is damaged or contradicts the call, `UserError` if the encoder
        has come back with other pictures.
        """
        if arrival.session < self._session:
            return
        if arrival.session > self._session:
            self._begin(arrival.session)
        yield from self._placed(self._receiving.receive(arrival))
        if (model := self.model) is not None:
            shown = int(self._next * SPEECH_FRAMES_PER_SECOND / model.call.exact_fps)
            old = shown - self._kept_speech_s * SPEECH_FRAMES_PER_SECOND
            # What follows is not known yet before a pause: nobody could have taken the last words.
            self.speech.drop_before(min(old, self.speech.known_until))

    def poll(self, now_s: float) -> Iterator[PlayoutFrame]:
        """The frames to show at `now_s` although nothing has come.  Raises as `receive`."""
        yield from self._placed(self._receiving.poll(now_s))
        due, playout = self._shown.frame_due(now_s), self._shown.playout
        if due is not None and not playout.is_frozen and not self.ended:
            yield from self._hold_until((self._shown.offset or 0) + due)

    def _begin(self, session: int) -> None:
        """Take packets from an encoder that has started again."""
        self._receiving, self._session = EncoderSession(self._max_wait_s), session
        self._restarts += 1
        first, *others = self._sessions
        for each in others:
            if each is not self._shown:
                self._past.add(each)
        kept = [each for each in others if each is self._shown]
        self._sessions = [first, *kept, self._receiving]

    def _placed(self, frames: Iterator[PlayoutFrame]) -> Iterator[PlayoutFrame]:
        """Frames of the encoder that is heard, with their place in the call."""
        session = self._receiving
        for frame in frames:
            model = session.playout.model
            assert model is not None
            if session.offset is None:
                if frame.index < model.call.start_frame:
                    continue
                session.offset = self._offset_of(session, frame.index)
                yield from self._hold_until(session.offset + frame.index)
                self._return.interrupt()
                self._go_on_speaking(session, model.call.exact_fps)
                self._shown = session
            self._next = session.offset + frame.index + 1
            face = self._smoothed(frame.face, model.call.focal_px)
            yield replace(frame, index=self._next - 1, face=face)
        if repaired := session.playout.take_repaired():
            self._return.correct(repaired)

    def _go_on_speaking(self, session: EncoderSession, fps: Fraction) -> None:
        """Hear another start of the encoder from the next frame on."""
        assert session.offset is not None
        per_frame = SPEECH_FRAMES_PER_SECOND / fps
        is_same = session.voice.voice == self._shown.voice.voice
        is_same |= self._shown.playout.model is None
        # The decoder of the one before would not understand another codec.
        speech = session.voice.speech if is_same else SpeechFrames()
        self.speech.go_on(speech, round(self._next * per_frame), round(session.offset * per_frame))

    def _smoothed(self, face: FaceParameters, focal_px: float) -> FaceParameters:
        shown = self._return.shown
        if shown is not None and focal_px != self._focal_px:
            self._return.shown = with_focal_change(shown, focal_px / self._focal_px)
        self._focal_px = focal_px
        return self._return.show(face)

    def _offset_of(self, session: EncoderSession, index: int) -> int:
        """The offset of a session whose first picture has this index in it."""
        assert session.playout.model is not None
        if self._shown.playout.model is None:
            return 0
        before, after = self._shown.playout.model.call, session.playout.model.call
        if picture_of(before) != picture_of(after):
            raise UserError(
                f"the encoder came back with pictures of {after.width}x{after.height} at"
                f" {after.fps:g}/s, before they were {before.width}x{before.height} at"
                f" {before.fps:g}/s: decode it anew",
                LINK_FAILED,
            )
        starts_s = self._shown.clock.start_s, session.clock.start_s
        elapsed = 0
        if starts_s[0] is not None and starts_s[1] is not None:
            elapsed = (self._shown.offset or 0) + round((starts_s[1] - starts_s[0]) * before.fps)
        return max(elapsed, self._next - index)

    def _hold_until(self, end: int) -> Iterator[PlayoutFrame]:
        """The face shown last, as lost, for every source frame before `end`."""
        held, session = self._return.shown, self._shown
        while held is not None and self._next < end:
            self._return.interrupt()
            self._next += 1
            session.playout.skip_to(self._next - (session.offset or 0))
            yield PlayoutFrame(self._next - 1, held, frozen=True, lost=True)
