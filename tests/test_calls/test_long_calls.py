"""What a call of hours keeps of its frames does not grow with them."""

from decoder.playout.received_frames import DecodeStats
from encoder.calls.session_stats import SessionStats
from encoder.live_model.work_level import WorkLevel


def test_times_are_kept_only_for_a_report() -> None:
    for keeps_times in (False, True):
        sent, shown = SessionStats(keeps_times=keeps_times), DecodeStats(keeps_times=keeps_times)
        sent.note_captured(0)
        sent.note_frame(0.02, 0.0, WorkLevel.FULL, is_omitted=False)
        shown.note_drawn(8.0)
        kept = len(sent.capture_ns), len(sent.frame_ms), len(shown.frame_ms)
        assert kept == (keeps_times,) * 3
