"""The play-out of one encoder's packets: one face per source frame, in order.

Coded faces are less frequent than source frames; the faces between two coded ones are interpolated.
Before the first coded face and after the last, the nearest one is repeated; while the encoder has
lost the face, its last one is repeated (a frozen face).  A live call is therefore delayed by the
time between two coded faces.  Where packets are lost the face is concealed (`concealment`).
"""

from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

import numpy as np

from decoder.playout.concealment import at_rest, bridge
from decoder.playout.frame_decoder import TimedFace
from decoder.playout.received_models import ReceivedModel, ReceivedModels
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.frames.frame_times import FrameClock, TimesPacket
from protocol.limits import FIRST_WINDOW, LATE_WINDOW, SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    Packet,
)
from protocol.picture_residual.residual_block import CodedResidual
from shared_model.geometry import interpolate
from shared_model.parameters import FaceParameters, with_focal_change

# A packet may be at most so far ahead of the last frame (ten minutes).
MAX_FROZEN_S = 600
# A person who has left fades from the picture in this time.
FADE_S = 0.3


@dataclass(frozen=True, slots=True)
class PlayoutFrame:
    """The face of source frame `index`.

    model: the model that it was decoded by.
    time_s: when the frame is shown, seconds from the start of the source.
    lost: its packet is missing; the face is concealed.
    frozen: it repeats an older face: the encoder had none there, or too much is lost.
    presence: 1 to 0: how much of the person to draw; less than 1 after they have left.
    residual: what the picture has besides, as its packet says; None: nothing.
    """

    index: int
    face: FaceParameters
    model: ModelPacket
    time_s: Fraction
    frozen: bool = False
    lost: bool = False
    presence: float = 1.0
    residual: CodedResidual | None = None


class Playout:
    """Turns the packets of one encoder into the faces of its source frames, in order.

    model: the model of the newest frames, None before a model packet.  An update is activated by
        the frame packet with its sequence number.  The layers received are applied.
    clock: when source frames are shown.
    ended: the END packet has been received.
    is_frozen: the encoder has lost the face.
    is_camera_off: the sender has switched the camera off.
    gone_at: source frame from which on the person of a lost face is not there; None: they are.
    lost, late, unusable: numbers of frame packets that were missing when they were due, that came
        too late or twice, and that preceded the model packet.
    before_join: source frames shown that precede the first frame packet.
    """

    def __init__(self) -> None:
        self.clock = FrameClock()
        self.ended = self.joined_late = self.is_camera_off = False
        self.gone_at: int | None = None
        self._lost_at: int | None = None  # source frame from which on the face is lost
        self.lost = self.late = self.unusable = self.before_join = 0
        self._begin = self._next = 0
        self._newest = -1  # number of the newest frame packet
        self._is_numbered = False  # numbers are those of the call, not only modulo 64
        self._last: TimedFace | None = None
        self._models = ReceivedModels()
        self._repaired: FaceParameters | None = None

    @property
    def model(self) -> ModelPacket | None:
        """See the class."""
        return self._models.current.model if self._models.current else None

    @property
    def is_frozen(self) -> bool:
        """See the class."""
        return self._lost_at is not None

    @property
    def next_model(self) -> ModelPacket | None:
        """The update that has been received for later frames, with all its pictures."""
        return self._models.next_model

    @property
    def next_frame(self) -> int:
        """The source frame to show next; less than 0 before it is known."""
        return self._next

    def receive(self, packet: Packet, number: int | None = None) -> list[PlayoutFrame]:
        """The frames that can be shown after a packet, perhaps none.

        number: see `Arrival`; None: the packet's 6 bits tell.
        Raises `ProtocolError` if the packet is damaged or contradicts the call.
        """
        version = self._models.current
        if isinstance(packet, ModelPacket):
            self._receive_model(packet, number)
        elif isinstance(packet, LayerPacket):
            self._models.receive_layer(packet)
        elif isinstance(packet, TimesPacket):
            self.clock.receive(packet)
        elif version is None:
            self.unusable += 1
        elif isinstance(packet, FramePacket):
            return self._receive_frame(packet, number)
        else:
            return self._receive_control(version, packet, number)
        return []

    @property
    def next_number(self) -> int:
        """Number of the frame packet that follows the newest."""
        return self._newest + 1

    def time_s(self, number: int) -> float:
        """Time in the call of the last face of frame packet `number`, once there is a model."""
        current, update = self._models.current, self._models.update
        assert current is not None
        version = update if update is not None and number >= update.first else current
        return float(version.decoder.newest_frame(number - version.first)) / version.model.call.fps

    def time_of(self, frame: int, model: ModelPacket) -> Fraction:
        """The time of source frame `frame`, not before the one asked for last, seconds."""
        return self.clock.time_s(frame, model.call.exact_fps)

    def skip_to(self, index: int) -> None:
        """Do not show the source frames before `index` any more."""
        self._next = max(self._next, index)

    def take_repaired(self) -> FaceParameters | None:
        """The face shown last as it truly was, if a late packet has told so since asked before."""
        repaired, self._repaired = self._repaired, None
        return repaired

    def _receive_model(self, packet: ModelPacket, first: int | None) -> None:
        is_first = self._models.current is None
        if first is None:
            newest = packet.sequence if is_first else self._newest
            first = newest + (packet.sequence - newest) % SEQUENCE_MODULUS
        if is_first:
            self._newest = first - 1
            if packet.version:
                self._join_late()
        self._models.receive_model(packet, first)

    def _join_late(self) -> None:
        self.joined_late, self._next = True, -1

    def _join_at(self, version: ReceivedModel, frame: int) -> None:
        """Begin with source frame `frame`, as a file says that does so."""
        self._join_late()
        self._begin = self._next = frame
        self._newest, self._is_numbered = version.number_at(frame) - 1, True

    def _receive_frame(self, packet: FramePacket, exact: int | None) -> list[PlayoutFrame]:
        number, newest = self._number(packet.sequence, exact), self._newest
        if number <= newest:
            self._receive_late(number, packet)
            return []
        if self._models.update is not None and number >= self._models.update.first:
            self._activate_update(self._models.update)
        version = self._models.current
        assert version is not None
        own_number = number - version.first
        coded = version.decoder.decode(own_number, packet.payload)
        residual = version.decoder.residual(own_number, packet.payload, len(coded))
        self.lost += number - newest - 1
        self._newest = number
        frames = list[PlayoutFrame]()
        for place, timed in enumerate(coded):
            is_gap = place == 0 and number - newest > 1
            frames += self._frames_until(version.model, timed, is_gap)
            frozen = self.is_frozen and self._last is not None
            face = self._last.face if frozen and self._last else timed.face
            self._last = TimedFace(timed.timestamp, face)
        return [_with_residual(frame, residual) for frame in frames]

    def _receive_late(self, number: int, packet: FramePacket) -> None:
        """Let what was decoded without this packet become exact."""
        self.late += 1
        version = self._models.current
        assert version is not None
        if number < version.first:
            return
        newest = version.decoder.repair(number - version.first, packet.payload)
        if newest is not None and self._last is not None and not self.is_frozen:
            self._last = newest
            if self._next > newest.timestamp:
                self._repaired = newest.face

    def _activate_update(self, update: ReceivedModel) -> None:
        """Decode frame packets by `update` from now on."""
        assert self.model is not None
        ratio = update.model.call.focal_px / self.model.call.focal_px
        if self._last is not None:
            # Its mode coefficients belong to the model before.
            face = replace(
                with_focal_change(self._last.face, ratio), modes=np.zeros(0), layers=np.zeros(0)
            )
            self._last = replace(self._last, face=face)
        self._models.activate()

    def _number(self, sequence: int, exact: int | None) -> int:
        """The packet's number in the call, by the number that the link knows or by its 6 bits."""
        version = self._models.current
        assert version is not None
        if exact is not None:
            self._is_numbered = True
            ahead = exact - self._newest
        else:
            ahead = (sequence - self._newest) % SEQUENCE_MODULUS
        number = self._newest + ahead
        if self._last is None and self._newest < version.first and ahead > FIRST_WINDOW:
            self._join_late()
            self._newest = number - 1
        elif exact is None and ahead >= SEQUENCE_MODULUS - LATE_WINDOW:
            number -= SEQUENCE_MODULUS
        return number

    def _frames_until(
        self, model: ModelPacket, timed: TimedFace, is_gap: bool
    ) -> list[PlayoutFrame]:
        """Source frames after those shown before, up to the time of `timed`."""
        before, frames = self._last, list[PlayoutFrame]()
        if self._next < 0:
            self._next = ceil(timed.timestamp)
        self._check_gap(model.call, timed.timestamp)
        while self._next <= timed.timestamp:
            index, self._next = self._next, self._next + 1
            time_s = self.time_of(index, model)
            if self.is_frozen and before is not None:
                frame = self._repeated(model, index, time_s, before.face)
            elif before is None or index <= before.timestamp:
                self.before_join += is_gap and index < timed.timestamp
                is_early = index < model.call.start_frame
                frame = PlayoutFrame(index, timed.face, model, time_s, is_early)
            elif is_gap and index < timed.timestamp:
                face, is_held = bridge(before, timed, index)
                frame = PlayoutFrame(index, face, model, time_s, is_held, lost=True)
            else:
                fraction = (index - before.timestamp) / (timed.timestamp - before.timestamp)
                face = interpolate(before.face, timed.face, float(fraction))
                frame = PlayoutFrame(index, face, model, time_s)
            frames.append(frame)
        return frames

    def _receive_control(
        self, version: ReceivedModel, packet: ControlPacket, following: int | None
    ) -> list[PlayoutFrame]:
        if packet.kind in (ControlKind.CAMERA_OFF, ControlKind.CAMERA_ON):
            self.is_camera_off = packet.kind is ControlKind.CAMERA_OFF
            return []
        if packet.kind is ControlKind.JOINED:
            if following is None and self._last is None:
                self._join_at(version, packet.frame)
            return []
        begin = self._begin if packet.kind is ControlKind.END else 0
        frames = self._frozen_until(version.model, begin + packet.frame)
        if packet.kind is ControlKind.END:
            self.ended = True
        elif packet.kind is ControlKind.FACE_LOST:
            self._lost_at = packet.frame
        elif packet.kind is ControlKind.PERSON_GONE:
            self.gone_at = packet.frame
        else:
            self._lost_at = self.gone_at = None
            # Without a face no packets were sent: their numbers are skipped.
            if following is None and (self._is_numbered or not self.joined_late):
                following = version.number_at(packet.frame)
            self._newest = max(self._newest, (following or 0) - 1)
        return frames

    def _frozen_until(self, model: ModelPacket, end: int) -> list[PlayoutFrame]:
        """The last face for every source frame before `end`."""
        if self._last is None or (self.joined_late and not self._is_numbered):
            return []
        self._check_gap(model.call, end)
        first, self._next = self._next, max(self._next, end)
        return [
            self._repeated(model, index, self.time_of(index, model), self._last.face)
            for index in range(first, end)
        ]

    def _repeated(
        self, model: ModelPacket, index: int, time_s: Fraction, face: FaceParameters
    ) -> PlayoutFrame:
        """A frame that shows an older face; one that is lost goes to rest, or fades."""
        presence = 1.0
        if self._lost_at is not None:
            face = at_rest(face, model, float((index + 1 - self._lost_at) / model.call.fps))
        if self.gone_at is not None and self.is_frozen:
            fade = max(1.0, FADE_S * model.call.fps)
            presence = max(0.0, 1 - (index + 1 - self.gone_at) / fade)
        return PlayoutFrame(index, face, model, time_s, self.is_frozen, presence=presence)

    def _check_gap(self, call: CallParameters, end: int | Fraction) -> None:
        if end - self._next > MAX_FROZEN_S * call.fps:
            raise ProtocolError(
                f"call jumps from frame {self._next} to {int(end)}, limit {MAX_FROZEN_S} s"
            )


def _with_residual(frame: PlayoutFrame, residual: CodedResidual | None) -> PlayoutFrame:
    """A frame with its packet's residual, unless its face is not that of the packet."""
    if residual is None or frame.frozen or frame.lost or frame.index < residual.first:
        return frame
    return replace(frame, residual=residual)
