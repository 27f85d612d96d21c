"""A learner that takes its time beside a call in real time, by a clock that stands still."""

from concurrent.futures import Future
from itertools import islice
from pathlib import Path

from call_contents import packets_of, played
from conftest import LIVE_MODEL_BYTES, without_layers
from live_encoders import live_encoder

from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.live_model.learner import LocalLearner, TrainingTask
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.pacing import REAL_TIME
from protocol.call_file import CallWriter
from protocol.model_packet import ModelPacket

# Of the call; those that an update takes to be trained.
FRAMES, LATE = 75, 12


class LateLearner(LocalLearner):
    """What it trains is there `LATE` frames later.

    now: the frame.  begun: the frame at which each update was begun.
    """

    def __init__(self) -> None:
        super().__init__()
        self.now, self.begun = 0, list[int]()
        self._waiting = list[tuple[int, "Future[ModelVersion]", ModelVersion]]()

    def train(self, task: TrainingTask) -> "Future[ModelVersion]":
        """See `Learner`."""
        assert not self._waiting, "an update is begun while another is trained"
        later = Future[ModelVersion]()
        self.begun.append(self.now)
        self._waiting.append((self.now + LATE, later, super().train(task).result()))
        return later

    def advance(self, frame: int) -> None:
        """It is frame `frame` now."""
        self.now = frame
        while self._waiting and self._waiting[0][0] <= frame:
            _, later, version = self._waiting.pop(0)
            later.set_result(version)


def test_an_update_is_used_as_soon_as_it_may_be_and_no_frame_waits_for_it(
    carphone: Path, networks: Path, tmp_path: Path
) -> None:
    path, learner, stats = tmp_path / "call.rzo", LateLearner(), SessionStats()
    with open_source(str(carphone)) as capture, CallWriter(path) as sink, without_layers():
        session = live_encoder(
            capture, sink, stats, LIVE_MODEL_BYTES, realtime=True, learner=learner
        )
        for index, picture in islice(capture, FRAMES):
            learner.advance(index)
            session.frame(index, picture)
        frames, fps = index + 1, float(capture.fps)
        session.end(frames)
    assert [frame.index for frame in played(path)] == list(range(frames))
    models = [packet for packet in packets_of(path) if isinstance(packet, ModelPacket)]
    first, update = (model.call for model in models)
    (begun,) = learner.begun
    assert begun - fps * next(iter(REAL_TIME.updates)) < 2
    # It is announced with the packet of the frames of that time, and used so many packets later.
    waited = update.start_frame - (begun + LATE)
    packet_frames = first.frames_per_packet * first.frame_step
    assert REAL_TIME.lead_packets * packet_frames <= waited + packet_frames
    assert waited <= (REAL_TIME.lead_packets + 1) * packet_frames
