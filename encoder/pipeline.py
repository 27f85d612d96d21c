"""capture -> landmarks -> fit -> model packet; then per frame: pose and EAUs -> packets."""

import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event

import numpy as np
from numpy.typing import NDArray

from encoder.calls.live_session import LiveCall
from encoder.calls.session_callbacks import Console, Progress
from encoder.calls.session_stats import Tally
from encoder.calls.thesis_session import ThesisCall
from encoder.calls.two_pass_session import Survey, send_call
from encoder.calls.warm_up import rehearse
from encoder.capture.video_source import Capture, open_source
from encoder.coding.gop import cadence_for
from encoder.coding.model_packet import budget_for
from encoder.coding.progressive_model import LayerPacer
from encoder.runtime.parallel import read_ahead, switching_often
from encoder.tracking.trackers import FOLLOWED, FollowOptions, open_follower
from protocol.call_file import CallWriter
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ
from protocol.link.interface import CONNECT_TIMEOUT_S, LinkOptions, PacketSink, Reach, Say, silent
from shared_model.errors import UserError
from shared_model.mesh import generic_head
from shared_model.surround import surrounded_head

Picture = NDArray[np.uint8]

NO_FACE = 3
# What the user should know of a call whose end did not reach anybody.
UNHEARD = {
    Reach.NOBODY: "nobody listened when the call ended",
    Reach.NO_LINK: "the link had broken when the call ended",
}


@dataclass(frozen=True, slots=True)
class EncodeOptions:
    """What to encode and where to send it.

    source: video file, image pattern (frame_%04d.png), camera index or URL.
    output: call file; connect, listen: Zenoh endpoints (tcp/HOST:PORT) and `call` the call's name.
    lossless: over the network no packet is dropped, however slow: for measurements, not live calls.
    follow: how the thesis profile follows the face.
    profile: "thesis" or "default".
    bitrate: bits per second that frame packets take (default profile).
    startup_bitrate: bits per second of all packets together while the model is sent in layers
        (default profile), above `bitrate`; None: it is sent whole, at once.
    fps: code about this many frames a second (default profile), see `cadence_for`; None: all.
    live: look at nothing before it is sent, as if the source were a camera (default profile).
    pace: send at the source's own rate, as a camera would, instead of as fast as possible.
    wait_for_peer_s: wait this long for a decoder before the first frame, beginning with the link;
        0: do not wait, but for the link to be made.
    look_for_face_s: say so if there is no face after this many seconds of video.
    model_bytes: about as large the model packet shall be; None: as is usual for the profile.
    """

    source: str
    output: Path | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    call: str = "call"
    lossless: bool = False
    profile: str = "default"
    bitrate: float = 800.0
    startup_bitrate: float | None = None
    fps: float | None = None
    live: bool = False
    follow: FollowOptions = field(default_factory=FollowOptions)
    pace: bool = False
    max_frames: int | None = None
    wait_for_peer_s: float = 0.0
    look_for_face_s: float = 10.0
    model_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class EncodeReport:
    """What was sent.

    frames: of the call.  fps, width, height: of the source.
    coded_fps: frames a second that were coded.
    model_bytes, frame_bytes: payload of the packets.
    stage_ms: mean time per frame of each stage, ms.
    capture_ns: `time.monotonic_ns` at which each source frame was read.
    reach: whom the last packet could reach.
    """

    frames: int
    fps: float
    coded_fps: float
    width: int
    height: int
    model_bytes: int
    frame_bytes: int
    packets: int
    lost_frames: int
    stage_ms: dict[str, float]
    warnings: tuple[str, ...]
    capture_ns: tuple[int, ...]
    reach: Reach


def encode(
    options: EncodeOptions,
    progress: Progress,
    stop: Callable[[], bool],
    say: Say = silent,
    preparing: Say = silent,
) -> EncodeReport:
    """Encode one source to its end, or until `stop`; what was sent by then is a whole call.

    progress, stop, say, preparing: see `Console`.
    Raises `UserError` if the source cannot be read, shows no face, or the call cannot be sent,
    `ValueError` if `startup_bitrate` leaves nothing for the model beside the frames.
    """
    tally, console = Tally(), Console(progress, stop, say, preparing)
    with ExitStack() as stack:
        stack.enter_context(switching_often())
        capture = stack.enter_context(open_source(options.source))
        if capture.is_rate_assumed:
            rate = f"{float(capture.fps):g} frames a second"
            tally.warn(f"{capture.name} states no usable frame rate: taken as {rate}")
        sink = open_sink(options, stack, say)
        send = send_thesis if options.profile == "thesis" else send_default
        send(options, capture, sink, tally, console)
        if sink.reach in UNHEARD:
            tally.warn(UNHEARD[sink.reach])
        if tally.lost_frames:
            frames = len(tally.capture_ns)
            tally.warn(f"no face in {tally.lost_frames} of {frames} frames")
        return _report(options, capture, tally, sink.reach)


def send_thesis(
    options: EncodeOptions,
    capture: Capture,
    sink: PacketSink,
    tally: Tally,
    console: Console,
) -> None:
    """Follow the face frame by frame and send as it goes."""
    size = (capture.width, capture.height)
    elapsed_s = float(1 / capture.fps)
    follower = open_follower(options.follow, generic_head(), size, FOLLOWED, elapsed_s, tally.warn)
    budget = budget_for("thesis", options.model_bytes)
    patience_s = options.look_for_face_s
    call = ThesisCall(capture, follower, sink, budget, patience_s, tally, options.follow.lids)
    send_frames(call, options, capture, tally, console)


def send_default(
    options: EncodeOptions,
    capture: Capture,
    sink: PacketSink,
    tally: Tally,
    console: Console,
) -> None:
    """Look at the whole source, then send the best call it allows; a live one frame by frame."""
    if options.live or capture.is_live:
        send_live(options, capture, sink, tally, console)
        return
    pacer = _pacer(options)
    survey = survey_source(options, capture, tally, console)
    call = survey.code(options.bitrate)
    if pacer is not None:
        model = survey.in_layers(call)
        call = replace(call, model=model.first)
        pacer.begin(model)
    if options.pace:
        send_call(call, sink, tally, float(capture.fps), console.stop, pacer)
    else:
        # Whoever stopped while the source was looked at has what was seen until then.
        send_call(call, sink, tally, None, lambda: False, pacer)


def send_live(
    options: EncodeOptions,
    capture: Capture,
    sink: PacketSink,
    tally: Tally,
    console: Console,
) -> None:
    """Send every frame as it comes, in the default profile."""
    budget = budget_for("live", options.model_bytes)
    # A source that waits for its reader may wait for the learning, too.
    wait = not (options.pace or capture.is_live)
    cadence = cadence_for(capture.fps, options.fps)
    if not wait:
        console.preparing("getting ready")
        with skipped_meanwhile(capture):
            rehearse(surrounded_head(), capture, cadence, np.random.default_rng(0))
        console.preparing("")
    call = LiveCall(
        capture,
        sink,
        budget,
        options.bitrate,
        options.look_for_face_s,
        tally,
        wait,
        cadence,
        _pacer(options),
    )
    send_frames(call, options, capture, tally, console)


@contextmanager
def skipped_meanwhile(capture: Capture) -> Iterator[None]:
    """Nobody is ready for what a live source gives until the `with` block is left."""
    if not capture.is_live:
        yield
        return
    ready = Event()
    with ThreadPoolExecutor(1) as beside:
        skipping = beside.submit(capture.skip_while, lambda: not ready.is_set())
        try:
            yield
        finally:
            ready.set()
        skipping.result()


def send_frames(
    call: ThesisCall | LiveCall,
    options: EncodeOptions,
    capture: Capture,
    tally: Tally,
    console: Console,
) -> None:
    """Send every frame of a source as it comes.  Raises `UserError` if no face was in any."""
    with closing(with_coming(capture, options, tally, console.stop)) as frames:
        for index, frame, coming in frames:
            call.frame(index, frame, coming)
            console.progress(index + 1, expected_frames(capture, options))
    if not call.started:
        raise no_face(options.source, len(tally.capture_ns))
    call.end(len(tally.capture_ns))


def survey_source(
    options: EncodeOptions,
    capture: Capture,
    tally: Tally,
    console: Console,
) -> Survey:
    """Go over the whole source, twice, and learn its caller: ready to be coded at any rate.

    Raises `UserError` if the source shows no face, and `KeyboardInterrupt` if it was stopped before
    there is anything to code.
    """
    try:
        return _survey(options, capture, tally, console)
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt("nothing was coded yet") from interrupt


def _survey(options: EncodeOptions, capture: Capture, tally: Tally, console: Console) -> Survey:
    survey = Survey(capture, tally, cadence_for(capture.fps, options.fps))
    console.preparing("looking first")
    unpaced = replace(options, pace=False)
    with closing(with_coming(capture, unpaced, tally, console.stop)) as frames:
        for index, frame, coming in frames:
            survey.frame(index, frame, coming)
            console.progress((index + 1) // 2, expected_frames(capture, options))
    if not survey.faces_seen:
        raise no_face(options.source, len(tally.capture_ns))
    if console.stop():
        raise KeyboardInterrupt
    console.preparing("learning the caller")
    survey.learn(budget_for("default", options.model_bytes))
    console.preparing("")
    with open_source(options.source) as again:
        survey.refine(frames_again(again, len(tally.capture_ns), tally, console))
    if not survey.faces_refined:
        raise KeyboardInterrupt
    return survey


def frames_again(
    capture: Capture, count: int, tally: Tally, console: Console
) -> Iterator[tuple[int, Picture]]:
    """The first `count` frames of a source that was looked at before."""
    frames = iter(capture)
    for number in range(count):
        with tally.stage("capture"):
            item = next(frames, None)
        if item is None or console.stop():
            return
        yield item
        console.progress((count + number + 1) // 2, count)


def expected_frames(capture: Capture, options: EncodeOptions) -> int | None:
    """How many frames there will be to encode; None: nobody knows."""
    counts = [n for n in (capture.frame_count, options.max_frames) if n is not None]
    return min(counts, default=None)


def no_face(source: str, frames: int) -> UserError:
    """The error of a source without a face."""
    return UserError(
        f"{source}: no face found in {frames} frame{'' if frames == 1 else 's'};"
        " is one in the picture, upright and at least 20 pixels wide?",
        NO_FACE,
    )


def with_coming(
    capture: Capture, options: EncodeOptions, tally: Tally, stop: Callable[[], bool]
) -> Generator[tuple[int, Picture, Picture | None], None, None]:
    """The frames to encode, each with the next one, which can be looked at beside it.

    None where to wait for it would delay the call, and after the last.
    """
    frames = paced(capture, options, tally, stop)
    if options.pace or capture.is_live:
        for index, frame in frames:
            yield index, frame, None
        return
    before = next(frames, None)
    while before is not None:
        after = next(frames, None)
        yield *before, after[1] if after else None
        before = after


def paced(
    capture: Capture, options: EncodeOptions, tally: Tally, stop: Callable[[], bool]
) -> Iterator[tuple[int, Picture]]:
    """The frames to encode, at the source's own rate if asked for, else read beside the work."""
    start, waits = time.monotonic(), options.pace or capture.is_live
    frames = iter(capture) if waits else read_ahead(iter(capture))
    while not stop():
        with tally.stage("capture"):
            item = next(frames, None)
        if item is None or (options.max_frames is not None and item[0] >= options.max_frames):
            return
        if options.pace:
            time.sleep(max(0.0, start + float(item[0] / capture.fps) - time.monotonic()))
        tally.capture_ns.append(time.monotonic_ns())
        yield item


def open_sink(options: EncodeOptions, stack: ExitStack, say: Say) -> PacketSink:
    """Where the packets go: a call file or the network, closed with `stack`.

    say: see `encode`.
    Raises `UserError` if it cannot be written, or nobody is there within the time to wait.
    """
    if options.output is not None:
        return stack.enter_context(CallWriter(options.output))
    from protocol.link.zenoh_link import ZenohSink

    patience_s = options.wait_for_peer_s or CONNECT_TIMEOUT_S
    link = LinkOptions(options.call, options.listen, options.connect, patience_s, options.lossless)
    sink = stack.enter_context(ZenohSink(link, say))
    if options.wait_for_peer_s:
        sink.wait_for_peer(options.wait_for_peer_s)
    return sink


def _pacer(options: EncodeOptions) -> LayerPacer | None:
    if options.startup_bitrate is None:
        return None
    return LayerPacer(options.startup_bitrate, options.bitrate)


def _report(options: EncodeOptions, capture: Capture, tally: Tally, reach: Reach) -> EncodeReport:
    captured = len(tally.capture_ns)
    coded_fps = cadence_for(capture.fps, options.fps).coded_fps(capture.fps)
    return EncodeReport(
        frames=captured if tally.frames is None else tally.frames,
        fps=float(capture.fps),
        coded_fps=THESIS_RATE_HZ if options.profile == "thesis" else float(coded_fps),
        width=capture.width,
        height=capture.height,
        model_bytes=tally.model_bytes,
        frame_bytes=tally.frame_bytes,
        packets=tally.packets,
        lost_frames=tally.lost_frames,
        stage_ms={name: ns / 1e6 / max(captured, 1) for name, ns in tally.spent_ns.items()},
        warnings=tuple(tally.warnings),
        capture_ns=tuple(tally.capture_ns),
        reach=reach,
    )
