"""capture -> landmarks -> fit -> model packet; per frame: landmarks -> pose, EAUs -> packets."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from encoder.capture import Capture, open_source
from encoder.follow import Follower, blend, open_follower
from encoder.model import BUDGETS, Budget, build_model, reference_of
from protocol.link import PacketSink
from protocol.messages import (
    SEQUENCE_MODULUS,
    CallParameters,
    ControlKind,
    ControlPacket,
    FramePacket,
    ModelPacket,
    serialise,
)
from protocol.quantise import THESIS_RATE_HZ, encode_thesis
from protocol.recording import CallWriter
from shared_model.errors import UserError
from shared_model.mesh import generic_head
from shared_model.parameters import EAU_INDEX, THESIS_EAUS, FaceParameters

Picture = NDArray[np.uint8]
Progress = Callable[[int, int | None], None]

NO_FACE = 3


@dataclass(frozen=True, slots=True)
class EncodeOptions:
    """What to encode and where to send it.

    source: video file, image pattern (frame_%04d.png), camera index or URL.
    output: call file; connect, listen: Zenoh endpoints (tcp/HOST:PORT) and `call` the call's name.
    lossless: over the network no packet is dropped, however slow: for measurements, not live calls.
    detector: "network" or "haar" (Viola-Jones).
    pace: send at the source's own rate, as a camera would, instead of as fast as possible.
    wait_for_peer_s: wait this long for a decoder before the first frame; 0: do not wait.
    look_for_face_s: say so if there is no face after this many seconds of video.
    """

    source: str
    output: Path | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    call: str = "call"
    lossless: bool = False
    profile: str = "thesis"
    detector: str = "network"
    pace: bool = False
    max_frames: int | None = None
    wait_for_peer_s: float = 0.0
    look_for_face_s: float = 10.0
    budget: Budget | None = None


@dataclass(frozen=True, slots=True)
class EncodeReport:
    """What was sent.

    frames, fps, width, height: of the source.  model_bytes, frame_bytes: payload of the packets.
    stage_ms: mean time per frame of each stage, ms.
    capture_ns: `time.monotonic_ns` at which each source frame was read.
    """

    frames: int
    fps: float
    width: int
    height: int
    model_bytes: int
    frame_bytes: int
    packets: int
    lost_frames: int
    stage_ms: dict[str, float]
    warnings: tuple[str, ...]
    capture_ns: tuple[int, ...]


@dataclass(slots=True)
class _Tally:
    """What the report will say, as it grows."""

    model_bytes: int = 0
    frame_bytes: int = 0
    packets: int = 0
    lost_frames: int = 0
    warnings: list[str] = field(default_factory=list)
    capture_ns: list[int] = field(default_factory=list)
    spent_ns: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time in the `with` block for stage `name`."""
        start = time.perf_counter_ns()
        try:
            yield
        finally:
            self.spent_ns[name] = self.spent_ns.get(name, 0) + time.perf_counter_ns() - start

    def warn(self, message: str) -> None:
        """Note a line for the user, once."""
        if message not in self.warnings:
            self.warnings.append(message)


class ThesisSender:
    """Sends the thesis profile: ten samples a second, each interpolated at its own time."""

    def __init__(self, sink: PacketSink, model: ModelPacket, tally: _Tally) -> None:
        self._sink, self._tally = sink, tally
        self._model, call = model, model.call
        self._frames_per_sample = (
            Fraction(call.fps_numerator, call.fps_denominator) / THESIS_RATE_HZ
        )
        self._number = 0
        self._before: FaceParameters | None = None
        data = serialise(model)
        tally.model_bytes += len(data) - 1
        self._send(data)

    def send_face(self, index: int, face: FaceParameters) -> None:
        """Send the samples due up to source frame `index`, in which the caller is `face`."""
        before = self._before or face
        while (place := self._place()) <= index:
            share = 1.0 if place <= index - 1 else float(place - (index - 1))
            payload = encode_thesis(blend(before, face, share), self._model.reference_pose)
            self._tally.frame_bytes += len(payload)
            self._send(serialise(FramePacket(self._number % SEQUENCE_MODULUS, payload)))
            self._number += 1
        self._before = face

    def send_control(self, kind: ControlKind, frame: int) -> None:
        """Say what happened at source frame `frame`; after LOST no samples are due until FOUND."""
        if kind is ControlKind.FOUND:
            self._before = None
            while self._place() < frame:
                self._number += 1
        self._send(serialise(ControlPacket(0, kind, frame)))

    def _place(self) -> Fraction:
        return self._model.call.start_frame + self._number * self._frames_per_sample

    def _send(self, packet: bytes) -> None:
        with self._tally.stage("send"):
            self._sink.send(packet)
        self._tally.packets += 1


def encode(options: EncodeOptions, progress: Progress, stop: Callable[[], bool]) -> EncodeReport:
    """Encode one source to its end, or until `stop`; what was sent by then is a whole call.

    progress: called with the number of frames so far and of the whole source, if that is known.
    Raises `UserError` if the source cannot be read, shows no face, or the call cannot be sent.
    """
    tally = _Tally()
    with ExitStack() as stack:
        capture = stack.enter_context(open_source(options.source))
        sink = open_sink(options, stack)
        active = [EAU_INDEX[name] for name in THESIS_EAUS]
        size = (capture.width, capture.height)
        follower = open_follower(options.detector, generic_head(), size, active, tally.warn)
        caller = Caller(options, capture, follower, sink, tally)
        for index, frame in paced(capture, options, tally, stop):
            caller.frame(index, frame)
            progress(index + 1, capture.frame_count)
        caller.end()
        return _report(capture, tally)


class Caller:
    """The state of one call on the sending side."""

    def __init__(
        self,
        options: EncodeOptions,
        capture: Capture,
        follower: Follower,
        sink: PacketSink,
        tally: _Tally,
    ) -> None:
        self._options, self._capture, self._tally = options, capture, tally
        self._follower, self._sink = follower, sink
        self._sender: ThesisSender | None = None
        self._lost = False

    def frame(self, index: int, frame: Picture) -> None:
        """Find the face in source frame `index` and send what is due."""
        with self._tally.stage("follow"):
            face = self._follower.update(frame)
        if face is None:
            self._miss(index)
            return
        if self._sender is None:
            with self._tally.stage("model"):
                model = self._model(index, frame, face)
            self._sender = ThesisSender(self._sink, model, self._tally)
            face = reference_of(model)
        elif self._lost:
            self._sender.send_control(ControlKind.FOUND, index)
        self._lost = False
        self._sender.send_face(index, face)

    def end(self) -> None:
        """Close the call.  Raises `UserError` if no face was ever found."""
        frames = len(self._tally.capture_ns)
        if self._sender is None:
            raise UserError(
                f"{self._options.source}: no face found in {frames} frames;"
                " is one in the picture, upright and at least 20 pixels wide?",
                NO_FACE,
            )
        self._sender.send_control(ControlKind.END, frames)

    def _miss(self, index: int) -> None:
        self._tally.lost_frames += 1
        if self._sender is not None:
            if not self._lost:
                self._sender.send_control(ControlKind.LOST, index)
            self._lost = True
        elif index / self._capture.fps >= self._options.look_for_face_s:
            self._tally.warn(
                f"no face in the first {self._options.look_for_face_s:g} s; still looking"
            )

    def _model(self, index: int, frame: Picture, face: FaceParameters) -> ModelPacket:
        fitted = self._follower.fitted
        call = CallParameters(
            profile=self._options.profile,
            width=self._capture.width,
            height=self._capture.height,
            fps_numerator=self._capture.fps.numerator,
            fps_denominator=self._capture.fps.denominator,
            focal_px=fitted.camera.focal_px,
            start_frame=index,
        )
        return build_model(generic_head(), fitted, face, frame, call, self._options.budget or BUDGETS[self._options.profile])


def paced(
    capture: Capture, options: EncodeOptions, tally: _Tally, stop: Callable[[], bool]
) -> Iterator[tuple[int, Picture]]:
    """The frames to encode, at the source's own rate if asked for."""
    start = time.monotonic()
    frames = iter(capture)
    while not stop():
        with tally.stage("capture"):
            item = next(frames, None)
        if item is None or (options.max_frames is not None and item[0] >= options.max_frames):
            return
        if options.pace:
            time.sleep(max(0.0, start + float(item[0] / capture.fps) - time.monotonic()))
        tally.capture_ns.append(time.monotonic_ns())
        yield item


def open_sink(options: EncodeOptions, stack: ExitStack) -> PacketSink:
    """Where the packets go: a call file or the network, closed with `stack`.

    Raises `UserError` if it cannot be written, or nobody is there within the time to wait.
    """
    if options.output is not None:
        return stack.enter_context(CallWriter(options.output))
    from protocol.link_zenoh import LinkOptions, ZenohSink

    link = LinkOptions(options.call, options.listen, options.connect, lossless=options.lossless)
    sink = stack.enter_context(ZenohSink(link))
    if options.wait_for_peer_s:
        sink.wait_for_peer(options.wait_for_peer_s)
    return sink


def _report(capture: Capture, tally: _Tally) -> EncodeReport:
    frames = len(tally.capture_ns)
    return EncodeReport(
        frames=frames,
        fps=float(capture.fps),
        width=capture.width,
        height=capture.height,
        model_bytes=tally.model_bytes,
        frame_bytes=tally.frame_bytes,
        packets=tally.packets,
        lost_frames=tally.lost_frames,
        stage_ms={name: ns / 1e6 / max(frames, 1) for name, ns in tally.spent_ns.items()},
        warnings=tuple(tally.warnings),
        capture_ns=tuple(tally.capture_ns),
    )
