"""What an encoder run reports."""

import os
from dataclasses import dataclass

from encoder.calls.session_stats import LiveWork, SentBytes, SentVoice, SessionStats
from encoder.capture.video_source import Capture
from encoder.coding.gop import gop_for_fps
from encoder.options import EncodeOptions
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ
from protocol.link.interface import Reachability
from shared_model.stage_timer import StageTimes

USUAL_BITRATE = 800.0
# A call that takes a smaller share of a rate, or its model of a size, is as fine as can be.
USED_SHARE = 0.75
# Warnings about a call whose end reached nobody.
UNREACHED_MESSAGES = {
    Reachability.NO_PEER: "nobody listened when the call ended",
    Reachability.BUSY: "who listened when the call ended had another encoder",
    Reachability.NO_LINK: "the link had broken when the call ended",
}


@dataclass(frozen=True, slots=True)
class EncodeReport:
    """What was sent.

    frames: of the call.  fps, width, height: of the source.
    coded_fps: frames a second that were coded.
    lost_frames: source frames without a face.
    work: of a live call.
    skipped_frames: frames that the source left out because the encoder was late.
    cpu_s: CPU time of this process and of those that it has started, from their beginning.
    events: what the call says of its face, by name, and the source frame.
    capture_ns: `time.monotonic_ns` at which each source frame was read.
    reach: whom the last packet could reach.
    """

    frames: int
    fps: float
    coded_fps: float
    width: int
    height: int
    sent: SentBytes
    lost_frames: int
    stages: StageTimes
    warnings: tuple[str, ...]
    capture_ns: tuple[int, ...]
    reach: Reachability
    speech: SentVoice
    work: LiveWork
    skipped_frames: int
    cpu_s: float
    events: tuple[tuple[str, int], ...]


def report_of(
    options: EncodeOptions, capture: Capture, stats: SessionStats, reach: Reachability
) -> EncodeReport:
    """The report of a call that has ended, with warnings about how it went.

    reach: whom the last packet could reach.
    """
    if reach in UNREACHED_MESSAGES:
        stats.warn(UNREACHED_MESSAGES[reach])
    if stats.lost_frames:
        stats.warn(f"no face in {stats.lost_frames} of {stats.captured} frames")
    _warn_of_unused_bits(options, stats, stats.captured / float(capture.fps))
    captured = stats.captured
    coded_fps = gop_for_fps(capture.fps, options.fps).coded_fps(capture.fps)
    return EncodeReport(
        frames=captured if stats.frames is None else stats.frames,
        fps=float(capture.fps),
        coded_fps=THESIS_RATE_HZ if options.profile == "thesis" else float(coded_fps),
        width=capture.format.source_size[0],
        height=capture.format.source_size[1],
        sent=stats.sent,
        lost_frames=stats.lost_frames,
        stages=stats.timer.times(captured),
        warnings=tuple(stats.warnings),
        capture_ns=tuple(stats.capture_ns),
        reach=reach,
        speech=stats.speech,
        work=stats.work,
        skipped_frames=stats.next_index - captured,
        cpu_s=_cpu_s(),
        events=tuple((kind.name.lower(), frame) for kind, frame in stats.events),
    )


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _warn_of_unused_bits(options: EncodeOptions, stats: SessionStats, seconds: float) -> None:
    """Add a warning if the call is as fine as can be with much less than it was given."""
    taken = 8 * stats.sent.frame_bytes / seconds
    is_known = options.bitrate > USUAL_BITRATE and seconds >= 1 and not stats.missed_residuals
    if is_known and taken < USED_SHARE * options.bitrate:
        stats.warn(
            f"--bitrate {options.bitrate:g} is more than this call can use: as fine as can be, it"
            f" takes {taken:.0f} bits a second"
        )
    asked, sent = options.model_bytes, stats.sent.model_bytes
    if asked is not None and not options.startup_bitrate and sent < USED_SHARE * asked:
        stats.warn(
            f"--model-bytes {asked} is more than this model can use: as fine as can be, it takes"
            f" {sent} bytes"
        )
