"""A live encoder that learns in its own process, as tests of calls drive it, frame by frame."""

from collections.abc import Callable

from encoder.calls.live_session import LiveEncoder, LiveSettings
from encoder.calls.packet_sender import PacketSender
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import Capture
from encoder.coding.gop import gop_for_fps
from encoder.coding.model_packet import budget_for
from encoder.live_model.call_trainer import CallTrainers, FirstModel
from encoder.live_model.learner import Learner, LocalLearner
from encoder.live_model.pacing import pacing_of
from protocol.link.interface import PacketSink


def live_encoder(
    capture: Capture,
    sink: PacketSink,
    stats: SessionStats,
    model_bytes: int | None,
    realtime: bool,
    delay_s: float = 0.0,
    waits_for_modes: bool = False,
    clock: Callable[[], float] = lambda: 0.0,
    learner: Learner | None = None,
    early: FirstModel | None = None,
) -> LiveEncoder:
    """An encoder of 800 bit/s.

    learner: None: what it learns is there at once.
    early: see `LiveEncoder`.
    clock: by which it may be late; one that stands still unless it is given.
    """
    gop = gop_for_fps(capture.fps, None)
    pacing = pacing_of(capture.is_live, realtime, delay_s, waits_for_modes)
    learner, budget = learner or LocalLearner(), budget_for("live", model_bytes)
    return LiveEncoder(
        capture,
        PacketSender(sink, stats),
        stats,
        LiveSettings(800, gop, 10),
        CallTrainers(capture.format, gop, budget, pacing, learner.encode_background),
        learner,
        early=early,
        clock=clock,
    )
