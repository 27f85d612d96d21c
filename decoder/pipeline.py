"""Decoding of a call into a sink: call file or link -> pictures -> video, images or stream."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from decoder.call_pictures import CallPictures, DrawnFrame, FaceObserver
from decoder.playout.call_source import CallSource
from decoder.playout.duration import count_frames
from decoder.playout.playout import PlayoutFrame
from decoder.playout.received_frames import DecodeStats
from decoder.playout.receiver import Receiver
from decoder.sinks.frame_sink import ThreadedSink, check_sink, keeps_times, open_sink
from decoder.sinks.interface import FrameSink
from decoder.sinks.video_file import TIMED
from decoder.sound.sound_track import SoundTrack, open_sound_track
from protocol.call_parameters import CallParameters
from protocol.link.interface import MessageCallback, ignore_message
from shared_model.arrays import Picture, Samples
from shared_model.stage_timer import StageTimes, frame_times

Progress = Callable[[int, int | None], None]
ShowCallback = Callable[[DrawnFrame, CallParameters], None]
PlayCallback = Callable[[float, int, Samples], None]


@dataclass(frozen=True, slots=True)
class DecodeOptions(CallSource):
    """What to decode and where to put it.

    output: video file, image pattern, or an open stream for YUV4MPEG2; None: only measured.
    """

    output: Path | BinaryIO | None = None


@dataclass(frozen=True, slots=True)
class DecodeReport:
    """What was decoded.

    frames: pictures shown; fps: of the source; width, height: of the pictures that are written.
    model_bytes, frame_bytes: payload bytes of the packets received.  voice, voice_bytes: its codec,
        one of `VOICES`, and its share of the frame packets, which `frame_bytes` does not count.
    frame_ms: `frame_times`: how long a picture has taken after the first one, but for writing it.
    shown_ns: for each picture its source frame and `time.monotonic_ns` when it was complete.
    lost_packets, late_packets: frame packets not received in time; received too late or twice.
    frozen_frames: pictures that repeat an older face because the encoder had none.
    lost_frames: pictures in place of those whose packets were not received in time.
    before_join: pictures from before the first frame packet.
    restarts: how often the encoder has started again.
    complete: the call was decoded to its END packet.
    """

    frames: int
    fps: float
    width: int
    height: int
    model_bytes: int
    frame_bytes: int
    stages: StageTimes
    shown_ns: tuple[tuple[int, int], ...]
    lost_packets: int
    late_packets: int
    frozen_frames: int
    lost_frames: int
    before_join: int
    restarts: int
    complete: bool
    warnings: tuple[str, ...]
    voice: str = "off"
    voice_bytes: int = 0
    frame_ms: dict[str, float] = field(default_factory=dict)


def decode(
    options: DecodeOptions,
    progress: Progress,
    stop: Callable[[], bool],
    on_message: MessageCallback = ignore_message,
    show: ShowCallback | None = None,
    play: PlayCallback | None = None,
    observer: FaceObserver | None = None,
) -> DecodeReport:
    """Decode one call to its end, or until `stop`; pictures decoded by then are written.

    progress: called with the number of pictures so far and of the whole call, if that is known.
    on_message: called with a line when the link waits for an encoder.
    show: called with each picture and the sender's parameters, as soon as it is drawn.
    play: called with the voice as far as it is known up to the newest picture: time of its first
        sample in the call, seconds; samples per second; samples, (n,) int16.
    observer: takes the faces; pictures are drawn if it wants them or there is an output.
    Raises `UserError` if the call cannot be read, drawn or written; with exit code 4 if its encoder
    leaves before it has sent a face.
    """
    if isinstance(options.output, Path):
        check_sink(options.output)
    total = count_frames(options.call_file) if isinstance(options.call_file, Path) else None
    with ExitStack() as stack:

        def note(frame: DrawnFrame | PlayoutFrame) -> None:
            if not (frame.frozen and frame.lost):
                progress(pictures.stats.pictures, total)

        def pass_by(frame: PlayoutFrame) -> None:
            pictures.stats.note_shown(frame)
            output.pass_by(frame.index)
            note(frame)

        is_written = options.output is not None
        pictures = CallPictures(
            options, stop, on_message, observer=observer, draws_all=is_written, pass_by=pass_by
        )
        stack.enter_context(pictures).stats.keeps_times = True
        output = _Output(options.output, play, pictures, stack)
        for frame in pictures:
            output.add(frame)
            if show is not None:
                show(frame, pictures.sender)
            note(frame)
        output.finish()
        if not pictures.complete and (stop() or options.call_file is None):
            pictures.stats.warnings += _unfinished(options, output.sink, stop())
        if excess := pictures.trailing_bytes:
            warning = f"{excess} bytes after the end of the call are left out"
            pictures.stats.warnings.append(warning)
    return _report(pictures)


def _open_sink(
    output: Path | BinaryIO, pictures: CallPictures, sound: SoundTrack | None
) -> FrameSink:
    sender, shown = pictures.sender, pictures.shown
    fps, is_variable = sender.exact_fps, not pictures.receiver.shown.playout.clock.is_constant
    if is_variable and not keeps_times(output):
        pictures.stats.warnings.append(
            "the frame rate of the source varies, that of"
            f" {output.suffix if isinstance(output, Path) else 'YUV4MPEG2'} cannot: frames are not"
            f" shown at their own times ({' '.join(TIMED)} keep them)"
        )
    if sender.voice != "off" and sound is None:
        pictures.stats.warnings.append(
            f"without the voice ({sender.voice}): pip install '.[voice]' to hear it"
        )
    rate_hz = sound.rate_hz if sound is not None else None
    size, aspect = shown.source_size, shown.sample_aspect
    return open_sink(output, *size, fps, shown.colour_matrix, is_variable, rate_hz, aspect)


class _Output:
    """Where pictures and voice go, from the first picture on.

    path: see `DecodeOptions`.  play: see `decode`.  stack: closes the sink.
    sink: None before the first picture, or without a path.
    """

    def __init__(
        self,
        path: Path | BinaryIO | None,
        play: PlayCallback | None,
        pictures: CallPictures,
        stack: ExitStack,
    ) -> None:
        self._path, self._play, self._pictures, self._stack = path, play, pictures, stack
        self._start_s: float | None = None
        self._sound: SoundTrack | None = None
        self.sink: FrameSink | None = None

    def add(self, frame: DrawnFrame) -> None:
        """Write a picture, and give the voice that is known up to it."""
        if self._start_s is None:
            self._open(frame.index)
        if self.sink is not None:
            with self._pictures.timer.stage("write"):
                picture = in_source_size(frame.picture, self._pictures.shown.source_size)
                self.sink.write(picture, frame.time_s)
        self._give(self._pictures.receiver.speech.known_until)

    def pass_by(self, index: int) -> None:
        """Give the voice that is known up to a source frame that is drawn elsewhere."""
        if self._start_s is None:
            self._open(index)
        self._give(self._pictures.receiver.speech.known_until)

    def finish(self) -> None:
        """Give the rest of the voice, as long as there are pictures."""
        self._give(None)

    def _open(self, index: int) -> None:
        """Begin with a source frame."""
        sender = self._pictures.sender
        self._start_s = index / sender.fps
        if self._path is not None or self._play is not None:
            self._sound = open_sound_track(self._pictures.receiver.speech, sender, index)
        if self._path is not None:
            opened = _open_sink(self._path, self._pictures, self._sound)
            self.sink = self._stack.enter_context(ThreadedSink(opened))

    def _give(self, known_until: int | None) -> None:
        """Give the voice of the pictures so far.  known_until: see `SoundTrack.take`."""
        if self._sound is None or self._start_s is None:
            return
        time_s = self._start_s + self._sound.written / self._sound.rate_hz
        samples = self._sound.take(self._pictures.stats.pictures, known_until)
        if self.sink is not None:
            self.sink.write_sound(samples)
        if self._play is not None and len(samples):
            self._play(time_s, self._sound.rate_hz, samples)


def _unfinished(options: DecodeOptions, sink: FrameSink | None, stopped: bool) -> list[str]:
    """Keep an older video, which may be complete; warnings about a call without its end."""
    if stopped:
        warnings = ["stopped before the end of the call: decoded up to there"]
    else:
        warnings = ["the call has no end: decoded up to its last packet"]
    path = sink.mark_incomplete() if sink is not None else None
    if path is not None:
        warnings.append(f"{options.output} is older and stays; what was decoded is in {path}")
    return warnings


def _report(pictures: CallPictures) -> DecodeReport:
    stats, receiver, counts = pictures.stats, pictures.receiver, pictures.receiver.counts
    frames, warnings = stats.pictures, stats.warnings
    if not pictures.complete and not warnings:
        warnings.append("the call has no end: decoded up to its last packet")
    warnings += [f"damaged packet: {damage}" for damage in stats.damages]
    if more := stats.damaged - len(stats.damages):
        warnings.append(f"damaged packets: {more} more")
    warnings += _loss_warnings(receiver, stats)
    return DecodeReport(
        frames=frames,
        fps=pictures.sender.fps,
        width=pictures.shown.source_size[0],
        height=pictures.shown.source_size[1],
        model_bytes=counts.model_bytes,
        frame_bytes=counts.frame_bytes - counts.voice_bytes,
        stages=pictures.timer.times(frames),
        shown_ns=tuple(stats.shown_ns),
        lost_packets=counts.lost,
        late_packets=counts.late,
        frozen_frames=stats.frozen_frames,
        lost_frames=stats.lost_frames,
        before_join=receiver.first.playout.before_join,
        restarts=counts.restarts,
        complete=pictures.complete,
        warnings=tuple(warnings),
        voice=pictures.sender.voice,
        voice_bytes=counts.voice_bytes,
        frame_ms=frame_times(stats.frame_ms),
    )


def _loss_warnings(receiver: Receiver, stats: DecodeStats) -> Iterator[str]:
    first, counts = receiver.first.playout, receiver.counts
    if first.joined_late:
        missed = stats.shown_ns[0][0] if stats.shown_ns else 0
        yield f"joined a call under way: the {missed} frames before are missing"
    if first.before_join:
        yield f"joined a call under way: {first.before_join} pictures are from before it joined"
    if counts.restarts:
        yield f"the encoder has started again: {counts.restarts} times"
    if stats.lost_frames:
        share = f"{stats.lost_frames} of {stats.pictures} pictures"
        yield f"{counts.lost} frame packets did not come in time: {share} stand for lost ones"


def in_source_size(picture: Picture, size: tuple[int, int]) -> Picture:
    """A picture (h, w, 3) of a call in the width and height of its source.

    size: see `CallParameters.source_size`.
    """
    if size == (picture.shape[1], picture.shape[0]):
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
