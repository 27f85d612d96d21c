"""link or call file -> playout -> texture -> animate -> render and composite -> sinks."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from decoder.composite import Backdrop, make_backdrop, mouth_light, warp
from decoder.playout import PlayedFrame, Playout
from decoder.render import Renderer
from decoder.sink import Background, PictureSink, open_sink, padding_px
from decoder.texture import Wardrobe, decode_image
from protocol.link import PacketSource
from protocol.messages import Kind, ModelPacket, ProtocolError, packet_kind
from protocol.quantise import AAU_STEP, EAU_STEP, RESIDUAL_STEP_MM, values_from_codes
from protocol.recording import CallReader, TruncatedCall
from protocol.summary import summarise
from shared_model.animate import Face, identity_from_controls
from shared_model.errors import UserError
from shared_model.mesh import Head, generic_head
from shared_model.mouth_sheet import mouth_sheet_head

Picture = NDArray[np.uint8]
Progress = Callable[[int, int | None], None]

# In pictures up to this size lips and teeth are a pixel thick, and smoothing edges is cheap.
SMALL_PX = 352 * 288
SMALL_SAMPLES = 4
# How often a decoder that waits for packets looks whether it shall stop.
POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class DecodeOptions:
    """What to decode and where to put it.

    call_file: a recorded call; None: over the network.
    listen, connect: Zenoh endpoints such as tcp/0.0.0.0:7447; call: name of the call.
    output: video file or image pattern; None: only measured.
    """

    call_file: Path | None = None
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    call: str = "call"
    output: Path | None = None


@dataclass(frozen=True, slots=True)
class DecodeReport:
    """What was decoded.

    frames: pictures shown; fps, width, height: of the source.
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
    held_frames: int
    complete: bool
    warnings: tuple[str, ...]


class Scene:
    """One caller, ready to be drawn: face, texture and backdrop on the renderer."""

    def __init__(self, model: ModelPacket, head: Head) -> None:
        self._camera, self._head = model.call.camera, head
        # Where modes paint the inside of the mouth they have its light in them.
        self._shade_mouth = model.call.profile == "thesis"
        self._face = face_from_model(model, head)
        self._wardrobe = Wardrobe(model)
        still = decode_image("background", model.background)
        eau = values_from_codes(model.reference_eau, EAU_STEP)
        self._backdrop: Backdrop = make_backdrop(
            self._camera, model.reference_pose, head, self._face.animate(eau)
        )
        size = model.call.width, model.call.height
        self._renderer = Renderer(*size, head, edge_samples(*size))
        self._renderer.set_texture(self._wardrobe.texture(np.zeros(0)))
        self._renderer.set_backdrop(still, self._backdrop.grid_px)

    def draw(self, frame: PlayedFrame, clock: "StageClock") -> Picture:
        """The picture of one frame, (height, width, 3) uint8 BGR."""
        if self._wardrobe.changes:
            with clock.stage("texture"):
                self._renderer.set_texture(self._wardrobe.texture(frame.face.modes))
        with clock.stage("animate"):
            vertices = self._face.animate(frame.face.eau)
        with clock.stage("composite"):
            grid_px = warp(self._backdrop, frame.face.pose, vertices)
            light = mouth_light(self._head, vertices) if self._shade_mouth else 1.0
        with clock.stage("render"):
            return self._renderer.draw(self._camera, frame.face.pose, vertices, grid_px, light)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


class StageClock:
    """Adds up the time of each stage."""

    def __init__(self) -> None:
        self._total_ns: dict[str, int] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time in the `with` block for stage `name`."""
        start = time.perf_counter_ns()
        try:
            yield
        finally:
            spent = time.perf_counter_ns() - start
            self._total_ns[name] = self._total_ns.get(name, 0) + spent

    def mean_ms(self, frames: int) -> dict[str, float]:
        """Milliseconds per frame of each stage."""
        return {name: ns / 1e6 / max(frames, 1) for name, ns in self._total_ns.items()}


@dataclass(slots=True)
class _Tally:
    """What the report will say, as it grows."""

    model_bytes: int = 0
    frame_bytes: int = 0
    held_frames: int = 0
    damaged: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    shown_ns: list[tuple[int, int]] = field(default_factory=list)


def decode(options: DecodeOptions, progress: Progress, stop: Callable[[], bool]) -> DecodeReport:
    """Decode one call to its end, or until `stop`; what was decoded by then is kept.

    progress: called with the number of pictures so far and of the whole call, if that is known.
    Raises `UserError` if the call cannot be read, drawn or written.
    """
    total = _expected_frames(options)
    playout, tally, clock = Playout(), _Tally(), StageClock()
    with ExitStack() as stack:
        source = stack.enter_context(open_source(options))
        scene: Scene | None = None
        sink: PictureSink | None = None
        for frame in played_frames(source, playout, tally, stop):
            if scene is None:
                assert playout.model is not None
                scene, sink = _open_outputs(playout.model, options, tally, stack)
            picture = scene.draw(frame, clock)
            tally.shown_ns.append((frame.index, time.monotonic_ns()))
            tally.held_frames += frame.held
            if sink is not None:
                with clock.stage("write"):
                    sink.write(picture)
            progress(len(tally.shown_ns), total)
    return _report(playout, tally, clock, _name(options))


def open_source(options: DecodeOptions) -> PacketSource:
    """The call file or the network, whichever the options name.  Raises `UserError`."""
    if options.call_file is not None:
        return CallReader(options.call_file)
    from protocol.link_zenoh import LinkOptions, ZenohSource

    return ZenohSource(LinkOptions(options.call, options.listen, options.connect))


def played_frames(
    source: PacketSource, playout: Playout, tally: _Tally, stop: Callable[[], bool]
) -> Iterator[PlayedFrame]:
    """The faces of the call's source frames; damaged packets are noted and skipped."""
    for data in _packets(source, tally, stop):
        _count(data, tally)
        frames = playout.receive(data)
        while not stop():
            try:
                frame = next(frames, None)
            except ProtocolError as error:
                tally.damaged.append(str(error))
                break
            if frame is None:
                break
            yield frame
        if playout.ended:
            return


def head_of(model: ModelPacket) -> Head:
    """The mesh that the call's profile animates."""
    return mouth_sheet_head() if model.call.profile == "default" else generic_head()


def edge_samples(width: int, height: int) -> int:
    """Colour samples a pixel for a picture of this size."""
    return SMALL_SAMPLES if width * height <= SMALL_PX else 0


def face_from_model(model: ModelPacket, head: Head) -> Face:
    """The caller's own head."""
    aau = values_from_codes(model.aau, AAU_STEP)
    control_mm = values_from_codes(model.residual, RESIDUAL_STEP_MM).reshape(-1, 3)
    return Face(head, identity_from_controls(head, aau, control_mm))


def _packets(source: PacketSource, tally: _Tally, stop: Callable[[], bool]) -> Iterator[bytes]:
    while not stop() and not source.ended:
        try:
            packet = source.receive(POLL_S)
        except TruncatedCall as error:
            tally.warnings.append(f"the call is cut off: {error}")
            return
        except ProtocolError as error:
            tally.damaged.append(str(error))
            continue
        if packet is not None:
            yield packet


def _count(data: bytes, tally: _Tally) -> None:
    with suppress(ProtocolError):
        kind = packet_kind(data)
        if kind is Kind.MODEL and not tally.model_bytes:
            tally.model_bytes += len(data) - 1
        elif kind is Kind.FRAME:
            tally.frame_bytes += len(data) - 1


def _open_outputs(
    model: ModelPacket, options: DecodeOptions, tally: _Tally, stack: ExitStack
) -> tuple[Scene, PictureSink | None]:
    call = model.call
    try:
        scene = Scene(model, head_of(model))
    except ProtocolError as error:
        raise UserError(f"cannot decode {_name(options)}: {error}") from error
    stack.callback(scene.close)
    if options.output is None:
        return scene, None
    if any(padding_px(options.output, call.width, call.height)):
        tally.warnings.append(
            f"{call.width}x{call.height} is odd: the video repeats its last row or column; "
            "write images (frame%04d.png) to keep the size"
        )
    fps = Fraction(call.fps_numerator, call.fps_denominator)
    sink = open_sink(options.output, call.width, call.height, fps)
    return scene, stack.enter_context(Background(sink))


def _expected_frames(options: DecodeOptions) -> int | None:
    if options.call_file is None:
        return None
    with suppress(ProtocolError):
        return summarise(options.call_file).frames
    return None


def _name(options: DecodeOptions) -> str:
    return str(options.call_file) if options.call_file else f"call {options.call}"


def _report(playout: Playout, tally: _Tally, clock: StageClock, name: str) -> DecodeReport:
    model, frames = playout.model, len(tally.shown_ns)
    if model is None:
        reason = tally.damaged[0] if tally.damaged else "it has no model packet"
        raise UserError(f"cannot decode {name}: {reason}")
    if tally.damaged:
        tally.warnings.append(f"{len(tally.damaged)} damaged packets, first: {tally.damaged[0]}")
    if not playout.ended and not tally.warnings:
        tally.warnings.append("the call has no end: decoded up to its last packet")
    if playout.joined_late:
        tally.warnings.append("joined a call under way: the frames before are missing")
    return DecodeReport(
        frames=frames,
        fps=model.call.fps,
        width=model.call.width,
        height=model.call.height,
        model_bytes=tally.model_bytes,
        frame_bytes=tally.frame_bytes,
        stage_ms=clock.mean_ms(frames),
        shown_ns=tuple(tally.shown_ns),
        lost_packets=playout.lost,
        late_packets=playout.late,
        held_frames=tally.held_frames,
        complete=playout.ended,
        warnings=tuple(tally.warnings),
    )
