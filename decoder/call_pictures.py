"""The pictures of a call, drawn one after the other: packets -> playout -> scene."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from decoder.playout import Playout, PlayoutFrame
from decoder.reenactment import read_model, reenact
from decoder.scene import Scene, head_of
from protocol.call_file import CallReader
from protocol.call_parameters import CallParameters
from protocol.call_records import TruncatedCall
from protocol.errors import ProtocolError
from protocol.link.interface import (
    CONNECT_TIMEOUT_S,
    Arrival,
    LinkOptions,
    MessageCallback,
    PacketSource,
    ignore_message,
)
from protocol.model_packet import ModelPacket
from protocol.packets import PacketKind, packet_kind
from protocol.progressive_model import is_same_model
from protocol.security.link_security import LinkSecurity
from shared_model.errors import LINK_FAILED, UserError
from shared_model.stage_timer import StageTimer

Picture = NDArray[np.uint8]

# Interval at which a decoder that waits for packets calls `stop`.
POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class CallOptions:
    """The source of a call, and the person that is drawn.

    call_file: a recorded call, or an open stream of one; None: over the network.
    listen, connect: endpoints (HOST:PORT, tcp/HOST:PORT); call: name of the call.
    security: what protects the call over the network.
    connect_timeout_s: time limit for connecting; 0: the default.
    face: call file whose person is drawn instead; None: the call's own.
    """

    call_file: Path | BinaryIO | None = None
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    call: str = "call"
    connect_timeout_s: float = 0.0
    face: Path | None = None
    security: LinkSecurity = field(default_factory=LinkSecurity)


@dataclass(frozen=True, slots=True)
class DrawnFrame:
    """A picture (height, width, 3) uint8 BGR, and the index of its source frame.

    frozen: it repeats an older face.
    time_s: of the source frame, seconds from the start of the source.
    """

    index: int
    picture: Picture
    frozen: bool
    time_s: Fraction


@dataclass(slots=True)
class DecodeStats:
    """Counts, times and warnings of one call on the receiving side."""

    model_bytes: int = 0
    frame_bytes: int = 0
    frozen_frames: int = 0
    damages: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    shown_ns: list[tuple[int, int]] = field(default_factory=list)

    def note_damage(self, error: ProtocolError, playout: Playout) -> None:
        """Add a damaged packet with the first frame that it can affect."""
        model, frame = playout.model, max(playout.next_frame, 0)
        where = f", at frame {frame} ({frame / model.call.fps:.2f} s)" if model else ""
        self.damages.append(f"{error}{where}")


class CallPictures:
    """Draws the pictures of one call; a context manager that can be iterated once.

    While one picture is drawn, the next is prepared.  Attributes `stats`, `timer` and `playout`
    hold what the report needs.  Raises `UserError` if the call cannot be read or drawn; with exit
    code 4 if its encoder leaves before it has sent a face.
    """

    def __init__(
        self,
        options: CallOptions,
        stop: Callable[[], bool],
        on_message: MessageCallback = ignore_message,
    ) -> None:
        self.playout, self.stats, self.timer = Playout(), DecodeStats(), StageTimer()
        self._options, self._stop, self._stack = options, stop, ExitStack()
        self._target = read_model(options.face) if options.face else None
        self._source = self._stack.enter_context(open_source(options, on_message))
        self._scene: Scene | None = None
        self._submitted: PlayoutFrame | None = None

    @property
    def sender(self) -> CallParameters:
        """Parameters of the call.  Raises `UserError` if it has sent no model."""
        if self.playout.model is None:
            raise _no_model_error(self._options, self.stats, self._source.ended)
        return self.playout.model.call

    @property
    def shown(self) -> CallParameters:
        """Parameters of the call whose person is drawn: the size of the pictures."""
        return self.sender if self._target is None else self._target.call

    @property
    def trailing_bytes(self) -> int:
        """Bytes of a call file after the end of the call."""
        return self._source.trailing_bytes if isinstance(self._source, CallReader) else 0

    def __iter__(self) -> Iterator[DrawnFrame]:
        for frame in playout_frames(self._source, self.playout, self.stats, self._stop):
            if frame is None:
                yield from self._finished()
                continue
            sender = self.playout.model
            assert sender is not None
            target = self._target or sender
            if self._scene is None or self._scene.model is not target:
                yield from self._finished()
                with self.timer.stage("model"):
                    self._scene = self._change_scene(target)
            prepared = self._scene.prepare(reenact(frame, sender, target), self.timer)
            yield from self._finished()
            self._scene.submit(prepared, self.timer)
            self._submitted = frame
        yield from self._finished()
        if self.playout.model is None:
            raise _no_model_error(self._options, self.stats, self._source.ended)

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
        frame, self._submitted = self._submitted, None
        picture = self._scene.read_back(self.timer)
        self.stats.shown_ns.append((frame.index, time.monotonic_ns()))
        self.stats.frozen_frames += frame.frozen
        time_s = self.playout.clock.time_s(frame.index, self.sender.exact_fps)
        yield DrawnFrame(frame.index, picture, frame.frozen, time_s)

    def _change_scene(self, model: ModelPacket) -> Scene:
        before = self._scene
        if before is not None and is_same_model(before.model, model):
            try:
                before.update(model)
            except ProtocolError as error:
                self.stats.note_damage(error, self.playout)
            return before
        if before is not None:
            before.close()
        try:
            scene = Scene(model, head_of(model))
        except ProtocolError as error:
            drawn = self._options.face or call_name(self._options)
            raise UserError(f"cannot draw {drawn}: {error}") from error
        self._stack.callback(scene.close)
        return scene


def open_source(options: CallOptions, on_message: MessageCallback) -> PacketSource:
    """The call file or the network, whichever the options name.  Raises `UserError`.

    on_message: called with a line when the link waits for an encoder.
    """
    if options.call_file is not None:
        return CallReader(options.call_file)
    from protocol.link.zenoh_link import ZenohSource

    timeout_s = options.connect_timeout_s or CONNECT_TIMEOUT_S
    link = LinkOptions(
        options.call, options.listen, options.connect, timeout_s, security=options.security
    )
    return ZenohSource(link, on_message)


def playout_frames(
    source: PacketSource, playout: Playout, stats: DecodeStats, stop: Callable[[], bool]
) -> Iterator[PlayoutFrame | None]:
    """The faces of the call's source frames; None before each wait for a packet.

    Damaged packets are counted and skipped.
    """
    for arrival in _arrivals(source, playout, stats, stop):
        _count(arrival.data, stats)
        frames = playout.receive(arrival.data)
        while not stop():
            try:
                frame = next(frames, None)
            except ProtocolError as error:
                stats.note_damage(error, playout)
                break
            if frame is None:
                break
            yield frame
        if playout.ended:
            return
        yield None


def _arrivals(
    source: PacketSource, playout: Playout, stats: DecodeStats, stop: Callable[[], bool]
) -> Iterator[Arrival]:
    while not stop() and not source.ended:
        try:
            arrival = source.receive(POLL_S)
        except TruncatedCall as error:
            stats.warnings.append(str(error))
            return
        except ProtocolError as error:
            stats.note_damage(error, playout)
            continue
        if arrival is not None:
            yield arrival


def _count(data: bytes, stats: DecodeStats) -> None:
    with suppress(ProtocolError):
        kind = packet_kind(data)
        if kind in (PacketKind.MODEL, PacketKind.LAYER):
            stats.model_bytes += len(data) - 1
        elif kind is PacketKind.FRAME:
            stats.frame_bytes += len(data) - 1


def call_name(options: CallOptions) -> str:
    """The name of the call in messages."""
    if options.call_file is None:
        return f"call {options.call}"
    if isinstance(options.call_file, Path):
        return str(options.call_file)
    return "the call in the stream"


def _no_model_error(options: CallOptions, stats: DecodeStats, ended: bool) -> UserError:
    """The error of a call without a model.  ended: the call has ended; else the user stopped it."""
    if stats.damages or options.call_file is not None or not ended:
        reasons = [*stats.damages, *stats.warnings, "it has no model packet"]
        return UserError(f"cannot decode {call_name(options)}: {next(filter(None, reasons))}")
    return UserError(f"{call_name(options)}: its encoder left before it sent a face", LINK_FAILED)
