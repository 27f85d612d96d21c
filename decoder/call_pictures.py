"""The pictures of a call, drawn one after the other: packets -> playout -> scene."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Protocol, Self

import cv2
import numpy as np

from decoder.playout.call_source import CallSource, call_name, open_packet_source
from decoder.playout.playout import PlayoutFrame
from decoder.playout.received_frames import DecodeStats, Waiting, received_frames
from decoder.playout.receiver import Receiver
from decoder.scene.decoded_model import ModelLoader
from decoder.scene.reenactment import read_model, reenact
from decoder.scene.residual_picture import ResidualPicture
from decoder.scene.scene import Scene
from protocol.call_file import CallReader
from protocol.call_parameters import CallParameters
from protocol.errors import ProtocolError
from protocol.link.interface import MessageCallback, PacketSource, ignore_message
from protocol.model_packet import ModelPacket
from protocol.picture_residual.residual_block import CodedResidual
from protocol.progressive_model import is_same_model
from shared_model.arrays import Picture, Single
from shared_model.errors import LINK_FAILED, UserError
from shared_model.parameters import FaceParameters
from shared_model.stage_timer import StageTimer

# Frames by which a call file is read ahead of the picture: its models are decoded meanwhile.
FRAMES_AHEAD = 128
# Frames of a live call that may wait to be drawn while packets are taken.
MAX_WAITING = 64


@dataclass(frozen=True, slots=True)
class DrawnFrame:
    """A picture (height, width, 3) uint8 BGR, and the index of its source frame.

    frozen: it repeats an older face; lost: its packet is missing.  What is both is shown in grey.
    time_s: of the source frame, seconds from the start of the source.
    face_area: where the face is, see `Scene.face_area`; None unless asked for.
    """

    index: int
    picture: Picture
    frozen: bool
    lost: bool
    time_s: Fraction
    face_area: Single | None = None


@dataclass(frozen=True, slots=True)
class _ReceivedFrame:
    """A frame to draw.

    drawn: the model that is drawn.
    arrival_s: `time.monotonic` when the newest packet before it came.
    """

    frame: PlayoutFrame
    drawn: ModelPacket
    arrival_s: float


class FaceObserver(Protocol):
    """Who takes the faces of a call, to draw them elsewhere."""

    @property
    def wants_pictures(self) -> bool:
        """Whether pictures are drawn here as well."""

    def see_model(self, model: ModelPacket) -> None:
        """A model of the call, with its layers so far, at the latest before its first face."""

    def see_frame(self, frame: PlayoutFrame, arrival_s: float) -> None:
        """The face of a source frame, in order.

        arrival_s: `time.monotonic` when the newest packet before it came.
        """


class CallPictures:
    """Draws the pictures of one call; a context manager that can be iterated once.

    Packets of a live call are taken between two pictures, too: so what they bring of a model is
    decoded while the frames before it are drawn.

    source: of the packets, waits no longer than it is asked to; None: what the options name.
    with_face_areas: say of each picture where its face is.
    observer: takes the faces as well; None: nobody does.
    draws_all: pictures are drawn whether or not the observer wants them.
    pass_by: called with each frame that is not drawn, since the observer does not want pictures.
    wants: whether to draw the picture of a source frame; who cannot draw all leaves some out.
    While a graphics card draws one picture, the next is prepared.  Attributes `stats`, `timer` and
    `receiver` hold what the report needs; `arrival_s`: `time.monotonic` when the packet came whose
    pictures are drawn.  Raises `UserError` if the call cannot be read or drawn;
    with exit code 4 if its encoder leaves before it has sent a face.
    """

    def __init__(
        self,
        options: CallSource,
        stop: Callable[[], bool],
        on_message: MessageCallback = ignore_message,
        source: PacketSource | None = None,
        wants: Callable[[int], bool] = lambda index: True,
        with_face_areas: bool = False,
        observer: FaceObserver | None = None,
        draws_all: bool = False,
        pass_by: Callable[[PlayoutFrame], None] = lambda frame: None,
    ) -> None:
        self.stats, self.timer = DecodeStats(), StageTimer()
        self.receiver = Receiver(on_damage=self._note_damage)
        self._drawn_ns = 0  # time of all stages until the newest picture was complete
        self._options, self._stop, self._stack = options, stop, ExitStack()
        self._wants, self._with_face_areas = wants, with_face_areas
        self._observer, self._draws_all, self._pass_by = observer, draws_all, pass_by
        self._face_area: Single | None = None  # of the newest frame that is complete, if needed
        self._target = read_model(options.face) if options.face else None
        self._source = self._stack.enter_context(source or open_packet_source(options, on_message))
        self._is_live = source is not None or options.call_file is None
        is_file = isinstance(options.call_file, Path) and not self._is_live
        self._frames_ahead = FRAMES_AHEAD if is_file else 0
        self._received = deque[_ReceivedFrame]()
        self.arrival_s: float | None = None
        self._sender: ModelPacket | None = None  # of the newest frame that was drawn
        self._loader = ModelLoader()
        self._stack.callback(self._loader.close)
        if self._is_live:
            # Meanwhile the encoder is looked for.
            self._loader.warm_up()
        self._scene: Scene | None = None
        self._stack.callback(self._close_scene)
        self._submitted: _ReceivedFrame | None = None
        self._face: FaceParameters | None = None  # of the frame before, as long as it looks so
        self._picture: Picture | None = None  # of the newest frame that is complete
        self._residual = ResidualPicture()

    @property
    def sender(self) -> CallParameters:
        """Parameters of the call.  Raises `UserError` if it has sent no model."""
        model = self._sender or self.receiver.model
        if model is None:
            raise _no_model_error(self._options, self.stats, self._source.ended)
        return model.call

    @property
    def shown(self) -> CallParameters:
        """Parameters of the call whose person is drawn: the size of the pictures."""
        return self.sender if self._target is None else self._target.call

    @property
    def complete(self) -> bool:
        """The call was drawn to its END packet."""
        return self.receiver.ended and not self._received

    @property
    def trailing_bytes(self) -> int:
        """Bytes of a call file after the end of the call."""
        return self._source.trailing_bytes if isinstance(self._source, CallReader) else 0

    def __iter__(self) -> Iterator[DrawnFrame]:
        for received in self._frames():
            if received is None:
                yield from self._finished()
                continue
            frame, target = received.frame, received.drawn
            self.arrival_s = received.arrival_s
            if self._observer is not None:
                self._observer.see_frame(frame, received.arrival_s)
            if not self._wants(frame.index):
                continue
            if not self._draws:
                self._pass_by(frame)
                continue
            self._sender = frame.model
            if self._scene is None or self._scene.model is not target:
                yield from self._finished()
                self._face = None
                with self.timer.stage("model"):
                    self._scene = self._change_scene(received)
            if frame.face is self._face:
                yield from self._finished()
                yield self._complete(received)
                continue
            prepared = self._scene.prepare(reenact(frame.face, frame.model, target), self.timer)
            yield from self._finished()
            self._scene.submit(prepared, self.timer)
            self._submitted, self._face = received, frame.face
        yield from self._finished()
        if self.receiver.model is None:
            raise _no_model_error(self._options, self.stats, self._source.ended)

    def _frames(self) -> Iterator[_ReceivedFrame | None]:
        """The frames to draw; None before each wait for a packet of a live call."""
        packets = self._source, self.receiver, self.stats
        for frames in received_frames(*packets, self._stop, self._frames_to_draw):
            self._prepare_models()
            self._received += map(self._with_model, frames)
            if self._is_live:
                yield self._received.popleft() if self._received else None
                continue
            while len(self._received) > self._frames_ahead and not self._stop():
                yield self._received.popleft()
            if not self._frames_ahead:
                yield None
        while self._received and not self._stop():
            yield self._received.popleft()

    def _frames_to_draw(self) -> Waiting:
        """Whether frames of a live call wait to be drawn."""
        if not self._is_live or not self._received:
            return Waiting.NONE
        return Waiting.SOME if len(self._received) < MAX_WAITING else Waiting.MANY

    def _with_model(self, frame: PlayoutFrame) -> _ReceivedFrame:
        drawn = self._target or frame.model
        if self._draws:
            self._loader.request(drawn)
        return _ReceivedFrame(frame, drawn, self.stats.arrival_s)

    @property
    def _draws(self) -> bool:
        """Whether pictures are drawn."""
        return self._draws_all or self._observer is None or self._observer.wants_pictures

    def _note_damage(self, error: ProtocolError) -> None:
        self.stats.note_damage(error, self.receiver)

    def close(self) -> None:
        """Free the scene; close the call file or leave the network."""
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _finished(self) -> Iterator[DrawnFrame]:
        """The picture that is being drawn, if there is one."""
        if self._scene is None or self._submitted is None:
            return
        received, self._submitted = self._submitted, None
        is_first = self._picture is None
        self._picture, self._face_area = self._scene.read_back(self.timer), None
        before_ns, self._drawn_ns = self._drawn_ns, self.timer.whole_ns("write")
        if not is_first:
            self.stats.note_drawn((self._drawn_ns - before_ns) / 1e6)
        yield self._complete(received)

    def _complete(self, received: _ReceivedFrame) -> DrawnFrame:
        """A frame with the newest picture."""
        assert self._picture is not None
        frame = received.frame
        self.stats.note_shown(frame)
        is_held = frame.lost and frame.frozen
        picture = in_grey(self._picture) if is_held else self._picture
        if frame.presence < 1 and self._scene is not None:
            picture = self._scene.without_person(picture, frame.presence)
        if frame.residual is not None and self._target is None:
            with self.timer.stage("residual"):
                picture = self._with_residual(picture, frame, frame.residual)
        area = self._area() if self._with_face_areas else None
        return DrawnFrame(frame.index, picture, frame.frozen, frame.lost, frame.time_s, area)

    def _area(self) -> Single:
        """Where the face is in the newest picture."""
        assert self._scene is not None
        if self._face_area is None:
            self._face_area = self._scene.face_area()
        return self._face_area

    def _with_residual(
        self, picture: Picture, frame: PlayoutFrame, residual: CodedResidual
    ) -> Picture:
        try:
            return self._residual.added_to(picture, residual, frame.index, self._area())
        except ProtocolError as error:
            self.stats.note_damage(error, self.receiver, frame.index)
            return picture

    def _prepare_models(self) -> None:
        """Begin to decode what has been received of models."""
        for model in (self.receiver.model, self.receiver.next_model):
            if model is not None and self._observer is not None:
                self._observer.see_model(model)
            if model is not None and self._target is None and self._draws:
                self._loader.request(model)

    def _change_scene(self, received: _ReceivedFrame) -> Scene:
        before, model = self._scene, received.drawn
        try:
            decoded = self._loader.get(model)
        except ProtocolError as error:
            drawn = self._options.face or call_name(self._options)
            raise UserError(f"cannot draw {drawn}: {error}") from error
        is_more = before is not None and is_same_model(before.model, model)
        noted = before.damages if before is not None and is_more else 0
        for damage in decoded.damages[noted:]:
            self.stats.note_damage(damage, self.receiver, received.frame.index)
        if before is not None and before.fits(decoded):
            before.change(decoded)
            return before
        if before is not None:
            before.close()
        return Scene(decoded)

    def _close_scene(self) -> None:
        if self._scene is not None:
            self._scene.close()


def in_grey(picture: Picture) -> Picture:
    """The picture (h, w, 3) uint8 BGR without its colours."""
    return np.asarray(cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR))


def _no_model_error(options: CallSource, stats: DecodeStats, ended: bool) -> UserError:
    """The error of a call without a model.  ended: the call has ended; else the user stopped it."""
    if stats.damages or options.call_file is not None or not ended:
        reasons = [*stats.damages, *stats.warnings, "it has no model packet"]
        return UserError(f"cannot decode {call_name(options)}: {next(filter(None, reasons))}")
    return UserError(f"{call_name(options)}: its encoder left before it sent a face", LINK_FAILED)
