"""Encodes a source: its frames in, the packets of a call out.

    thesis    frame -> track -> ten samples a second -> packets
    live      frame -> landmarks -> fit -> packet filled -> coded -> packets
    two-pass  frames -> landmarks -> model -> frames again -> fit -> whole call coded -> packets
    thesis with texture modes: two-pass, by the faces that are tracked instead of landmarks

Each is a session of `encoder.calls` or `encoder.thesis`; those of one pass are a `CallSession`,
those of two a `RecordedPass`.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial

from encoder.calls.call_session import CallSession, FramePass, RecordedPass, run_pass
from encoder.calls.early_model import EarlyModelMaker
from encoder.calls.face_search import open_landmark_search
from encoder.calls.frame_source import FrameSource, dropping_frames
from encoder.calls.live_residual import LiveResidual
from encoder.calls.live_session import LiveEncoder, LiveSettings
from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_residual import with_residual
from encoder.calls.recorded_session import RecordedEncoder, send_call
from encoder.calls.session_callbacks import CallEvents, Progress, SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.calls.two_pass_session import EncodedCall
from encoder.capture.live_capture import by_arrival
from encoder.capture.spooled_pipe import spooled
from encoder.capture.video_source import Capture, is_pipe, open_source
from encoder.coding.gop import GopStructure, gop_for_fps
from encoder.coding.model_packet import ModelBudget, budget_for
from encoder.coding.pacer import MIN_FRAGMENT_BYTES, LayerPacer
from encoder.coding.thin_link import LAYER_BYTES, THIN_BPS, startup_rate
from encoder.live_model.call_trainer import CallTrainers, FirstModel
from encoder.live_model.learner import LocalLearner
from encoder.live_model.learning_process import LearningProcess
from encoder.live_model.other_face import FaceChoice, OtherFace, version_of_picture
from encoder.live_model.pacing import pacing_of
from encoder.option_rules import check_delay
from encoder.options import EncodeOptions
from encoder.packet_sink import open_packet_sink
from encoder.report import EncodeReport, report_of
from encoder.residual.residual_encoder import faces_bitrate, has_residual
from encoder.residual.residual_worker import LocalResidual, ResidualProcess
from encoder.sound.recorded_speech import chosen_voice, open_voice
from encoder.sound.voice_packer import VoicePacker
from encoder.thesis.texture_mode_session import TextureModeEncoder
from encoder.thesis.thesis_session import ThesisEncoder
from encoder.thesis.trackers import TRACKED_EAUS, FaceTracker, open_tracker
from encoder.thesis.tracking_options import TrackingOptions
from protocol.link.interface import MessageCallback, PacketSink, ignore_message
from runtime.parallel import beside, one_blas_thread, short_switch_interval
from shared_model.arrays import Array, Picture
from shared_model.errors import NO_FACE, UserError
from shared_model.mesh import generic_head

_log = logging.getLogger(__name__)

# The user is told of every so many frames of the third pass.
TOLD_INTERVAL = 25


@dataclass(frozen=True, slots=True)
class EncodeRun:
    """One source on its way into a call: what is asked, what comes in, what is counted and told."""

    options: EncodeOptions
    capture: Capture
    stats: SessionStats
    callbacks: SessionCallbacks

    @property
    def gop(self) -> GopStructure:
        """Of the default profile."""
        gop = gop_for_fps(self.capture.fps, self.options.fps)
        return gop.with_low_delay() if self.options.low_delay else gop

    def tracker(self, tracking: TrackingOptions) -> FaceTracker:
        """Of the thesis profile."""
        size, frame_s = (self.capture.width, self.capture.height), float(1 / self.capture.fps)
        warn = self.stats.warn
        return open_tracker(tracking, generic_head(), size, TRACKED_EAUS, frame_s, warn)

    def packets(
        self,
        sink: PacketSink,
        pacer: LayerPacer | None,
        voice: VoicePacker | None,
        residual: LiveResidual | None = None,
    ) -> PacketSender:
        """What sends its packets."""
        return PacketSender(sink, self.stats, pacer, self.capture.times, voice, residual)


def encode(
    options: EncodeOptions,
    progress: Progress,
    stop: Callable[[], bool],
    on_message: MessageCallback = ignore_message,
    on_preparing: MessageCallback = ignore_message,
    events: CallEvents | None = None,
) -> EncodeReport:
    """Encode one source to its end, or until `stop`; what was sent by then is a whole call.

    progress, stop, on_message, on_preparing, events: see `SessionCallbacks`.
    Raises `UserError` if the source cannot be read, shows no face, or the call cannot be sent,
    `ValueError` if `startup_bitrate` leaves nothing for the model in addition to the frames.
    """
    stats = SessionStats()
    callbacks = SessionCallbacks(progress, stop, on_message, on_preparing, events=events)
    with ExitStack() as stack:
        stack.enter_context(one_blas_thread())
        stack.enter_context(short_switch_interval())
        if is_pipe(options.source) and _is_read_twice(options):
            on_message("what comes through the pipe is read to its end first; --live: as it comes")
            options = replace(options, source=stack.enter_context(spooled(options.source)))
        capture = open_source(options.source, square_pixels=True)
        if capture.is_live and options.profile == "default":
            capture = by_arrival(capture)
        stack.enter_context(capture)
        check_delay(options.delay_s, options.live or capture.is_live)
        run = EncodeRun(options, capture, stats, callbacks)
        voice = _open_voice(options, stats)
        sink = open_packet_sink(options, stack, on_message)
        is_live = options.profile == "default" and (options.live or capture.is_live)
        if not is_live:
            _wait_for_peer(options, sink)
        if options.profile == "thesis" and not options.texture_modes:
            encode_thesis(run, sink, voice)
        elif is_live:
            encode_live(run, sink, voice)
        else:
            encode_two_pass(run, sink, voice)
        for note in capture.notes:
            stats.warn(note)
        # A link tells only now whether the end has been heard.
        sink.close()
        return report_of(options, capture, stats, sink.reachability)


def _is_read_twice(options: EncodeOptions) -> bool:
    if options.profile == "thesis":
        return options.texture_modes > 0
    return not options.live


def encode_thesis(run: EncodeRun, sink: PacketSink, voice: VoicePacker | None = None) -> None:
    """Track the face frame by frame and send ten samples a second."""
    options, packets = run.options, run.packets(sink, None, voice)
    session = ThesisEncoder(
        run.capture,
        run.tracker(options.tracking),
        packets,
        budget_for("thesis", options.model_bytes),
        options.look_for_face_s,
        run.stats,
        options.tracking.eyelids,
    )
    run_session(session, packets, run)


def encode_live(run: EncodeRun, sink: PacketSink, voice: VoicePacker | None = None) -> None:
    """Fit, code and send every frame as it comes."""
    options, capture, callbacks, gop = run.options, run.capture, run.callbacks, run.gop
    waits_for_modes = not (options.two_way or options.low_delay)
    pacing = pacing_of(capture.is_live, options.pace, options.delay_s, waits_for_modes)
    # In layers, over a thin link, a model does not grow with the rate.
    budget = budget_for("live", options.model_bytes)
    own_process = pacing.in_real_time
    with (
        closing(LearningProcess(run.stats.warn) if own_process else LocalLearner()) as learner,
        _live_residual(run, own_process) as residual,
    ):
        if isinstance(learner, LearningProcess):
            callbacks.on_preparing("warming up")
            with dropping_frames(capture):
                drawn = learner.warm_up(capture.format, gop, residual is not None)
                if residual is not None and drawn is not None:
                    residual.warm_up(*drawn)
            callbacks.on_preparing("")
            _log.info("warmed up")
        # Whoever comes finds an encoder that is ready.
        trainers = CallTrainers(capture.format, gop, budget, pacing, learner.encode_background)
        early = _wait_for_peer_with_model(run, sink, trainers)
        pacer = _pacer(run, sink)
        if pacer is None:
            budget = budget_for("live", options.model_bytes, options.bitrate)
            trainers = replace(trainers, budget=budget)
        elif residual is not None:
            residual.close()
            residual = None
        packets = run.packets(sink, pacer, voice, residual)
        bitrate = options.bitrate if residual is None else faces_bitrate(options.bitrate)
        settings = LiveSettings(bitrate, gop, options.look_for_face_s)
        shown = _shown_face(callbacks.other_face, capture, gop, budget)
        session = LiveEncoder(
            capture, packets, run.stats, settings, trainers, learner, shown, callbacks.events, early
        )
        run_session(session, packets, run)


@contextmanager
def _live_residual(run: EncodeRun, in_real_time: bool) -> Iterator[LiveResidual | None]:
    """What adds the picture residual to a call that has bits for it.

    None: it has not, or it shows another face, or it is one end of a conversation, whose people
    would wait longer for an answer.
    """
    options, gop, warn = run.options, run.gop, run.stats.warn
    size, frames = (run.capture.width, run.capture.height), gop.frames_per_packet * gop.frame_step
    is_quick = options.two_way or options.low_delay
    shows_caller = run.callbacks.other_face is None
    may_have = has_residual(options.bitrate, size, frames) and shows_caller and not is_quick
    if options.draw is None or not may_have:
        yield None
        return
    worker = (
        ResidualProcess(options.draw, size, options.bitrate, warn)
        if in_real_time
        else LocalResidual(options.draw, size, options.bitrate)
    )
    with closing(LiveResidual(worker, warn)) as residual:
        yield residual


def _wait_for_peer_with_model(
    run: EncodeRun, sink: PacketSink, trainers: CallTrainers
) -> FirstModel | None:
    """See `_wait_for_peer`.  Returns the model that was made meanwhile.

    None: the source shows no face, or cannot be looked at before; or the model may go whole, or is
    trained from frames that wait.
    """
    options, capture = run.options, run.capture
    is_layered = options.startup_bitrate is not None and not options.delay_s
    if not (is_layered and options.wait_for_peer_s) or is_pipe(options.source):
        with dropping_frames(capture):
            _wait_for_peer(options, sink)
        return None
    maker = EarlyModelMaker(trainers)
    look = partial(maker.watch, capture) if capture.is_live else partial(maker.read, options.source)
    with beside(look):
        _wait_for_peer(options, sink)
    return maker.model


def _wait_for_peer(options: EncodeOptions, sink: PacketSink) -> None:
    """Wait for a decoder, if the user wants that.  Raises `UserError` if none has come in time."""
    if options.wait_for_peer_s:
        sink.wait_for_peer(options.wait_for_peer_s)


def _shown_face(
    other: OtherFace | None, capture: Capture, gop: GopStructure, budget: ModelBudget
) -> FaceChoice:
    """Raises `UserError` if no face is found in the picture of another one."""
    if other is None:
        return FaceChoice()
    search = open_landmark_search(SessionStats())

    def find(picture: Picture) -> Array | None:
        found = search.find(picture, None)
        return None if found is None else found.points

    with dropping_frames(capture):
        version = version_of_picture(other.picture, find, capture.format, gop, budget)
    return FaceChoice(other, version)


def encode_two_pass(run: EncodeRun, sink: PacketSink, voice: VoicePacker | None = None) -> None:
    """Go through the whole source twice, then code and send the call."""
    options = run.options
    pacer = _pacer(run, sink) if options.profile == "default" else None
    packets = run.packets(sink, pacer, voice)
    call = encode_recorded(first_and_second_pass(run), run, packets.pacer is not None)
    if options.pace:
        send_call(call, packets, run.capture.times, run.callbacks.stop)
    else:
        # A stop during the passes has ended the call already.
        send_call(call, packets, None, lambda: False)


def encode_recorded(
    encoder: RecordedPass, run: EncodeRun, progressive: bool = False
) -> list[EncodedCall]:
    """The parts of a call after both passes, with a picture residual where that pays.

    progressive: see `RecordedEncoder.encode`; then there is no residual.
    """
    options, stats, callbacks = run.options, run.stats, run.callbacks
    bitrate = options.bitrate
    if options.draw is None or progressive or not encoder.may_have_residual(bitrate):
        return encoder.encode(bitrate, progressive)
    callbacks.on_preparing("picture residual")
    try:
        with open_source(options.source, square_pixels=True) as capture, stats.stage("residual"):
            faces = encoder.encode(faces_bitrate(bitrate))
            return with_residual(
                faces, options.draw, _told(capture, callbacks), bitrate, callbacks.stop
            )
    except UserError as error:
        stats.warn(f"without a picture residual: {error}")
        return encoder.encode(bitrate)
    finally:
        callbacks.on_preparing("")


def _told(
    frames: Iterable[tuple[int, Picture]], callbacks: SessionCallbacks
) -> Iterator[tuple[int, Picture]]:
    """The frames of a third pass, whose progress the user is told."""
    for index, picture in frames:
        if index % TOLD_INTERVAL == 0:
            callbacks.on_preparing(f"picture residual, frame {index}")
        yield index, picture


def run_session(session: CallSession, packets: PacketSender, run: EncodeRun) -> None:
    """Run a session over all frames.  Raises `UserError` if none shows a face."""
    options, stop = run.options, run.callbacks.stop
    source = FrameSource(run.capture, run.stats, stop, options.max_frames, options.pace)

    def next_frame(done: int, total: int | None) -> None:
        packets.send_times(done)
        run.callbacks.progress(done, total)

    packets.send_times(0)
    _run_pass(session, source, next_frame, options.source)
    session.end(run.stats.next_index)


def first_and_second_pass(run: EncodeRun) -> RecordedPass:
    """Go through the whole source twice: the encoder is ready for any bitrate.

    Raises `UserError` if the source shows no face, and `KeyboardInterrupt` if it was stopped before
    there is anything to code.
    """
    try:
        encoder = first_pass(run)
        second_pass(encoder, run)
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt("nothing was coded yet") from interrupt
    return encoder


def first_pass(run: EncodeRun) -> RecordedPass:
    """Landmarks or the tracked face of every frame, then the model of the person."""
    options, callbacks = run.options, run.callbacks
    encoder = _recorded_pass(run)
    source = FrameSource(run.capture, run.stats, callbacks.stop, options.max_frames)
    callbacks.on_preparing("first pass")

    def first_half(done: int, total: int | None) -> None:
        callbacks.progress(done // 2, total)

    _run_pass(encoder, source, first_half, options.source)
    if callbacks.stop():
        raise KeyboardInterrupt
    callbacks.on_preparing("training the model")
    budget = budget_for(options.profile, options.model_bytes, options.bitrate)
    encoder.build_models(budget)
    callbacks.on_preparing("")
    return encoder


def _recorded_pass(run: EncodeRun) -> RecordedPass:
    """Raises `UserError` for texture modes of a source that ends when it likes."""
    options = run.options
    if options.profile == "default":
        return RecordedEncoder(run.capture, run.stats, run.gop)
    if run.capture.is_live:
        raise UserError(
            "--texture-modes looks at a whole recording before it sends; leave it out for a camera"
        )
    # Faces of before and after a refinement would be of different heads.
    tracking = replace(options.tracking, refine_identity=False)
    return TextureModeEncoder(
        run.capture,
        run.tracker(tracking),
        options.texture_modes,
        options.look_for_face_s,
        run.stats,
        options.tracking.eyelids,
    )


def second_pass(encoder: RecordedPass, run: EncodeRun) -> None:
    """Fit the face in every frame that is coded."""
    count = run.stats.captured

    def second_half(done: int) -> None:
        run.callbacks.progress((count + done) // 2, count)

    with open_source(run.options.source, square_pixels=True) as capture:
        source = FrameSource(capture, run.stats, run.callbacks.stop)
        encoder.fit_frames(source.second_pass(count, second_half))
    if not encoder.faces_fitted:
        raise KeyboardInterrupt


def _run_pass(frame_pass: FramePass, source: FrameSource, progress: Progress, name: str) -> None:
    with closing(source.with_lookahead()) as frames:
        run_pass(frame_pass, frames, source.expected_frames, progress)
    if not frame_pass.started:
        count = source.stats.captured
        raise UserError(
            f"{name}: no face found in {count} frame{'' if count == 1 else 's'};"
            " is one in the picture, upright and at least 20 pixels wide?",
            NO_FACE,
        )


def _pacer(run: EncodeRun, sink: PacketSink) -> LayerPacer | None:
    """Sends the model in layers where the link is thin, or the user says so; None: whole."""
    options, gop = run.options, run.gop
    packets_per_s = float(gop.coded_fps(run.capture.fps)) / gop.frames_per_packet
    # A lossless call waits for the link, whatever that carries.
    is_lossless = options.link is not None and options.link.lossless
    link_bps = None if is_lossless else sink.quality.rate_bps
    limit_bps = options.startup_bitrate
    rate_bps = startup_rate(link_bps, limit_bps, options.bitrate, packets_per_s)
    if rate_bps is None:
        return None
    is_thin = options.output is None and min(link_bps or THIN_BPS, rate_bps) < THIN_BPS
    fragment_bytes = LAYER_BYTES if is_thin else MIN_FRAGMENT_BYTES
    return LayerPacer(rate_bps, options.bitrate, fragment_bytes)


def _open_voice(options: EncodeOptions, stats: SessionStats) -> VoicePacker | None:
    stats.speech.voice, warning = chosen_voice(options.source, options.voice)
    if warning is not None:
        stats.warn(warning)
    return open_voice(options.source, stats.speech.voice, stats.warn)
