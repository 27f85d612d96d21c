"""link or call file -> playout -> scene (texture, animate, composite, render) -> sinks."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

from decoder.duration import count_frames
from decoder.frame_sink import FrameSink, ThreadedSink, check_sink, open_sink
from decoder.playout import Playout, PlayoutFrame
from decoder.reenactment import read_model, reenact
from decoder.scene import Scene, head_of
from protocol.call_file import CallReader, TruncatedCall
from protocol.errors import ProtocolError
from protocol.link.interface import (
    CONNECT_TIMEOUT_S,
    LinkOptions,
    MessageCallback,
    PacketSource,
    ignore_message,
)
from protocol.model_packet import ModelPacket
from protocol.packets import PacketKind, packet_kind
from protocol.progressive_model import is_same_model
from shared_model.errors import LINK_FAILED, UserError
from shared_model.stage_timer import StageTimer

Progress = Callable[[int, int | None], None]

# How often a decoder that waits for packets looks whether it shall stop.
POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class DecodeOptions:
    """What to decode and where to put it.

    call_file: a recorded call, or an open stream of one; None: over the network.
    listen, connect: Zenoh endpoints such as tcp/0.0.0.0:7447; call: name of the call.
    connect_timeout_s: for how long to try to connect; 0: as long as is usual.
    output: video file, image pattern, or an open stream for YUV4MPEG2; None: only measured.
    face: call file whose caller is drawn instead; None: the call's own.
    """

    call_file: Path | BinaryIO | None = None
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    call: str = "call"
    connect_timeout_s: float = 0.0
    output: Path | BinaryIO | None = None
    face: Path | None = None


@dataclass(frozen=True, slots=True)
class DecodeReport:
    """What was decoded.

    frames: pictures shown; fps: of the source; width, height: of the pictures.
    model_bytes, frame_bytes: payload bytes of the packets that came.
    stage_ms: mean time per frame of each stage, ms.
    shown_ns: for each picture its source frame and `time.monotonic_ns` when it was complete.
    lost_packets, late_packets: frame packets that never came, or too late.
    held_frames: pictures that repeat an older face because the encoder had none.
    complete: the call was decoded to its END packet.
    """

    frames: int
    fps: float
    width: int
    height: int
    model_bytes: int
    frame_bytes: int
    stage_ms: dict[str, float]
    shown_ns: tuple[tuple[int, int], ...]
    lost_packets: int
    late_packets: int
    frozen_frames: int
    complete: bool
    warnings: tuple[str, ...]


@dataclass(slots=True)
class _DecodeStats:
    """What the report will say, as it grows."""

    model_bytes: int = 0
    frame_bytes: int = 0
    frozen_frames: int = 0
    damaged: int = 0
    first_damage: str = ""
    warnings: list[str] = field(default_factory=list)
    shown_ns: list[tuple[int, int]] = field(default_factory=list)

    def note_damage(self, error: ProtocolError) -> None:
        """Count a damaged packet; the first one is told."""
        self.damaged += 1
        self.first_damage = self.first_damage or str(error)


class _FramePresenter:
    """Draws frames into a sink; while one is drawn the next is worked out."""

    def __init__(
        self,
        sink: FrameSink | None,
        tally: _DecodeStats,
        timer: StageTimer,
        progress: Callable[[int], None],
    ) -> None:
        self.scene: Scene | None = None
        self._sink, self._tally, self._timer, self._progress = sink, tally, timer, progress
        self._drawn: PlayoutFrame | None = None

    def add(self, frame: PlayoutFrame) -> None:
        """The next frame; the one before is finished."""
        assert self.scene is not None
        posed = self.scene.prepare(frame, self._timer)
        self.finish()
        self.scene.submit(posed, self._timer)
        self._drawn = frame

    def finish(self) -> None:
        """Have the newest frame in the sink, not only begun."""
        if self.scene is None or self._drawn is None:
            return
        frame, self._drawn = self._drawn, None
        picture = self.scene.read_back(self._timer)
        self._tally.shown_ns.append((frame.index, time.monotonic_ns()))
        self._tally.frozen_frames += frame.frozen
        if self._sink is not None:
            with self._timer.stage("write"):
                self._sink.write(picture)
        self._progress(len(self._tally.shown_ns))


def decode(
    options: DecodeOptions,
    progress: Progress,
    stop: Callable[[], bool],
    say: MessageCallback = ignore_message,
) -> DecodeReport:
    """Decode one call to its end, or until `stop`; what was decoded by then is kept.

    progress: called with the number of pictures so far and of the whole call, if that is known.
    say: takes a line that says where an encoder is waited for, over a network.
    Raises `UserError` if the call cannot be read, drawn or written; with exit code 4 if its encoder
    leaves without a word.
    """
    if isinstance(options.output, Path):
        check_sink(options.output)
    total = _expected_frames(options)
    target = read_model(options.face) if options.face else None
    playout, tally, timer = Playout(), _DecodeStats(), StageTimer()
    with ExitStack() as stack:
        source = stack.enter_context(open_source(options, say))
        show: _FramePresenter | None = None
        sink: FrameSink | None = None
        for frame in playout_frames(source, playout, tally, stop):
            if frame is None:
                if show is not None:
                    show.finish()
                continue
            sender = playout.model
            assert sender is not None
            shown = target or sender
            if show is None:
                sink = _open_sink(sender, shown, options, stack)
                show = _FramePresenter(sink, tally, timer, lambda done: progress(done, total))
            if show.scene is None or show.scene.model is not shown:
                show.finish()
                with timer.stage("model"):
                    show.scene = _change_scene(show.scene, shown, options, tally, stack)
            show.add(reenact(frame, sender, shown))
        if show is not None:
            show.finish()
        if not playout.ended and (stop() or options.call_file is None):
            tally.warnings += _unfinished(options, sink, stop())
        if isinstance(source, CallReader) and source.trailing_bytes:
            excess = source.trailing_bytes
            tally.warnings.append(f"{excess} bytes after the end of the call are left out")
    if playout.model is None:
        raise _no_picture_error(options, tally, source.ended)
    return _report(playout, playout.model, target, tally, timer)


def open_source(options: DecodeOptions, say: MessageCallback) -> PacketSource:
    """The call file or the network, whichever the options name.  Raises `UserError`.

    say: see `decode`.
    """
    if options.call_file is not None:
        return CallReader(options.call_file)
    from protocol.link.zenoh_link import ZenohSource

    patience_s = options.connect_timeout_s or CONNECT_TIMEOUT_S
    return ZenohSource(LinkOptions(options.call, options.listen, options.connect, patience_s), say)


def playout_frames(
    source: PacketSource, playout: Playout, tally: _DecodeStats, stop: Callable[[], bool]
) -> Iterator[PlayoutFrame | None]:
    """The faces of the call's source frames, None before a packet is waited for; damaged packets
    are noted and skipped."""
    for data in _packets(source, tally, stop):
        _count(data, tally)
        frames = playout.receive(data)
        while not stop():
            try:
                frame = next(frames, None)
            except ProtocolError as error:
                tally.note_damage(error)
                break
            if frame is None:
                break
            yield frame
        if playout.ended:
            return
        yield None


def _packets(
    source: PacketSource, tally: _DecodeStats, stop: Callable[[], bool]
) -> Iterator[bytes]:
    while not stop() and not source.ended:
        try:
            packet = source.receive(POLL_S)
        except TruncatedCall as error:
            tally.warnings.append(str(error))
            return
        except ProtocolError as error:
            tally.note_damage(error)
            continue
        if packet is not None:
            yield packet


def _count(data: bytes, tally: _DecodeStats) -> None:
    with suppress(ProtocolError):
        kind = packet_kind(data)
        if kind in (PacketKind.MODEL, PacketKind.LAYER):
            tally.model_bytes += len(data) - 1
        elif kind is PacketKind.FRAME:
            tally.frame_bytes += len(data) - 1


def _change_scene(
    before: Scene | None,
    model: ModelPacket,
    options: DecodeOptions,
    tally: _DecodeStats,
    stack: ExitStack,
) -> Scene:
    if before is not None and is_same_model(before.model, model):
        try:
            before.update(model)
        except ProtocolError as error:
            tally.note_damage(error)
        return before
    if before is not None:
        before.close()
    try:
        scene = Scene(model, head_of(model))
    except ProtocolError as error:
        raise UserError(f"cannot draw {options.face or _name(options)}: {error}") from error
    stack.callback(scene.close)
    return scene


def _open_sink(
    sender: ModelPacket,
    shown: ModelPacket,
    options: DecodeOptions,
    stack: ExitStack,
) -> FrameSink | None:
    call = shown.call
    if options.output is None:
        return None
    fps = Fraction(sender.call.fps_numerator, sender.call.fps_denominator)
    sink = open_sink(options.output, call.width, call.height, fps, call.colour_matrix)
    return stack.enter_context(ThreadedSink(sink))


def _unfinished(options: DecodeOptions, sink: FrameSink | None, stopped: bool) -> list[str]:
    """Keep an older video that may be complete; what to say of a call whose end did not come."""
    if stopped:
        said = ["stopped before the end of the call: decoded up to there"]
    else:
        said = ["the call has no end: decoded up to its last packet"]
    aside = sink.mark_incomplete() if sink is not None else None
    if aside is not None:
        said.append(f"{options.output} is older and stays; what was decoded is in {aside}")
    return said


def _expected_frames(options: DecodeOptions) -> int | None:
    return count_frames(options.call_file) if isinstance(options.call_file, Path) else None


def _name(options: DecodeOptions) -> str:
    if options.call_file is None:
        return f"call {options.call}"
    if isinstance(options.call_file, Path):
        return str(options.call_file)
    return str(getattr(options.call_file, "name", "the stream"))


def _no_picture_error(options: DecodeOptions, tally: _DecodeStats, ended: bool) -> UserError:
    """Why there was nothing to draw.  ended: the call, rather than our patience."""
    if tally.first_damage or options.call_file is not None or not ended:
        reasons = [tally.first_damage, *tally.warnings, "it has no model packet"]
        return UserError(f"cannot decode {_name(options)}: {next(filter(None, reasons))}")
    return UserError(f"{_name(options)}: its encoder left before it sent a face", LINK_FAILED)


def _report(
    playout: Playout,
    model: ModelPacket,
    target: ModelPacket | None,
    tally: _DecodeStats,
    timer: StageTimer,
) -> DecodeReport:
    frames = len(tally.shown_ns)
    if not playout.ended and not tally.warnings:
        tally.warnings.append("the call has no end: decoded up to its last packet")
    if tally.damaged:
        tally.warnings.append(f"damaged packets: {tally.damaged}, first: {tally.first_damage}")
    if playout.joined_late:
        tally.warnings.append("joined a call under way: the frames before are missing")
    return DecodeReport(
        frames=frames,
        fps=model.call.fps,
        width=(target or model).call.width,
        height=(target or model).call.height,
        model_bytes=tally.model_bytes,
        frame_bytes=tally.frame_bytes,
        stage_ms=timer.mean_ms(frames),
        shown_ns=tuple(tally.shown_ns),
        lost_packets=playout.lost,
        late_packets=playout.late,
        frozen_frames=tally.frozen_frames,
        complete=playout.ended,
        warnings=tuple(tally.warnings),
    )
